"""LASSO (scikit-learn) and SINDy (pysindy) on the arrays of screened cases; runs alone in the peers' environment."""

import json
import sys
import warnings
from pathlib import Path

import numpy as np
import pysindy
from sklearn.linear_model import LassoCV
from sklearn.model_selection import LeaveOneGroupOut

THRESHOLDS = (10.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01)  # of coefficients of standardised terms; the first leaves none
WINDOW = 101  # rows; a fit by cubics over it, about 150 s, is what is differentiated
STRIDE = 10  # rows; derivatives so smooth need no more


def by_lasso(case):
    """LASSO of the residual on all raw sensitivities, each of unit length, the penalty by leaving out one run."""
    length = np.linalg.norm(case["effects"], axis=0)
    columns = case["effects"] / np.where(length > 0.0, length, 1.0) * np.sqrt(case["run"].size)
    folds = list(LeaveOneGroupOut().split(columns, groups=case["run"]))
    found = LassoCV(fit_intercept=False, cv=folds, alphas=30, tol=1e-3, max_iter=1000).fit(columns, case["residual"])
    size = np.abs(found.coef_)
    ranking = ranked(case["names"], size)
    return {"adequate": not ranking, "ranking": ranking, "named": len(ranking)}


def by_sindy(case):
    """SINDy of the residuals' derivatives on polynomials of residuals, inputs and states of the model.

    The threshold is chosen by BIC; adequate where no term is left. The fitted right-hand side is mapped to effects by
    its cosine with the derivative, taken alike, of each raw sensitivity, over all channels and runs. Returned are what
    it says, and what it says if it has to name something: by the best model that has a term.
    """
    differentiate = pysindy.SmoothedFiniteDifference(
        smoother_kws={"window_length": WINDOW, "polyorder": 3, "axis": 0}
    )._differentiate
    runs = [one_run(case, number) for number in np.unique(case["run"])]
    slopes = [differentiate(x, t)[::STRIDE] for x, _, _, t in runs]
    size = np.std(np.concatenate(slopes), axis=0)
    slopes = [slope / size for slope in slopes]
    size = np.where(size > 0.0, size, 1.0)
    centre = np.mean(np.concatenate([u for _, u, _, _ in runs]), axis=0)
    spread = np.std(np.concatenate([u for _, u, _, _ in runs]), axis=0)
    varying = spread > 1e-9
    inputs = [(u[::STRIDE, varying] - centre[varying]) / spread[varying] for _, u, _, _ in runs]
    errors = [x[::STRIDE] / np.std(np.concatenate([y for y, _, _, _ in runs]), axis=0) for x, _, _, _ in runs]

    def fitted(threshold):
        model = pysindy.SINDy(
            optimizer=pysindy.STLSQ(threshold=threshold, alpha=1e-3),
            feature_library=pysindy.PolynomialLibrary(degree=2),
        )
        return model.fit(errors, t=[t[::STRIDE] for _, _, _, t in runs], x_dot=slopes, u=inputs)

    def cost(model):
        """Return the Bayesian information criterion; a smoothing window counts as one independent row."""
        left = [np.asarray(model.predict(x, u=u)) - slope for x, u, slope in zip(errors, inputs, slopes, strict=True)]
        independent = sum(slope.size for slope in slopes) * STRIDE / WINDOW
        terms = np.count_nonzero(model.coefficients())
        return independent * np.log(np.mean(np.concatenate(left) ** 2)) + terms * np.log(independent)

    tried = [fitted(threshold) for threshold in THRESHOLDS]
    best = min(tried, key=cost)
    adequate = not np.any(best.coefficients())
    model = min((each for each in tried if np.any(each.coefficients())), key=cost, default=None)
    if model is None:
        nothing = {"adequate": True, "ranking": [], "named": 0}
        return nothing, nothing
    said = np.concatenate([np.asarray(model.predict(x, u=u)).ravel() for x, u in zip(errors, inputs, strict=True)])
    cosines = []
    for place in range(case["names"].size):
        moved = [differentiate(s[:, :, place], t)[::STRIDE] / size for _, _, s, t in runs]
        moved = np.concatenate([one.ravel() for one in moved])
        length = np.linalg.norm(moved) * np.linalg.norm(said)
        cosines.append(abs(moved @ said) / length if length > 0.0 else 0.0)
    said = {"adequate": adequate, "ranking": ranked(case["names"], np.array(cosines)), "named": 1}
    return said, said | {"adequate": False}


def one_run(case, number):
    """Return residuals (rows, channels), conditions (rows, inputs), sensitivities (rows, channels, k) and times."""
    mine = case["run"] == number
    times = np.unique(case["conditions.time_s"][mine])
    given = sorted(name for name in case if name.startswith("conditions.") and name != "conditions.time_s")
    channels = np.unique(case["channel"])
    errors = np.zeros((times.size, channels.size))
    effects = np.zeros((times.size, channels.size, case["names"].size))
    for place, channel in enumerate(channels):
        rows = np.flatnonzero(mine & (case["channel"] == channel))
        if not rows.size:
            continue
        at = case["conditions.time_s"][rows]
        errors[:, place] = np.interp(times, at, case["residual"][rows])
        for column in range(case["names"].size):
            effects[:, place, column] = np.interp(times, at, case["effects"][rows, column])
    first = np.unique(case["conditions.time_s"][mine], return_index=True)[1]
    conditions = np.stack([case[name][mine][first] for name in given], axis=1)
    return errors, conditions, effects, times


def ranked(names, size):
    """Return the candidates by their strongest column."""
    return list(dict.fromkeys(str(names[place]) for place in np.argsort(-size, kind="stable") if size[place] > 1e-9))


def main(folders):
    """Write what both say into each case's folder."""
    warnings.simplefilter("ignore")
    for folder in map(Path, folders):
        with np.load(folder / "plain.npz") as file:
            case = {name: file[name] for name in file.files}
        said, forced = by_sindy(case)
        said = {"LASSO": by_lasso(case), "SINDy": said, "SINDy, made to name one": forced}
        (folder / "peers.json").write_text(json.dumps(said))


if __name__ == "__main__":
    main(sys.argv[1:])
