def parameterise_motor(case, progress=None):
    raise NotImplementedError
