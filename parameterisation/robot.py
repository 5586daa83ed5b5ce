def parameterise_robot(case, progress=None):
    raise NotImplementedError
