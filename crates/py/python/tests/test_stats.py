"""Statistics as values."""

from __future__ import annotations

import copy
import pickle
import warnings
from pathlib import Path

import fleet
import numpy as np
import pytest

import fleetfoot as ff
from fleetfoot.exceptions import DataError, NeedsLogsError, RequestError, StatisticError, WriteError


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    return fleet.fleet(tmp_path / "logs")


@pytest.fixture
def plan(files: list[str]) -> ff.Plan:
    return ff.Plan(fleet.SHARED, files, chunk_rows=40)


def scanned(plan: ff.Plan, files: list[str]) -> ff.Stats:
    return ff.scan(plan, files, keys="aircraft={dir1}")


def matrix(runs: list[dict[str, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    x = np.concatenate([np.column_stack([np.ones(len(run["t"])), run["x"], run["z"]]) for run in runs])
    return x, np.concatenate([run["y"] for run in runs])


def test_scans_of_a_plan_match_the_recipe(files: list[str], plan: ff.Plan) -> None:
    assert plan.tasks == ["along", "normal"]
    assert plan.functions == {"T": ["1", "x", "x^2"], "D": ["v", "v^2"]}
    assert plan.chunk_rows == 40 and "along : a = " in str(plan) and plan.hash[:12] in repr(plan)
    stats = ff.scan(fleet.SHARED, files, chunk_rows=40)
    assert stats.plan == plan and hash(stats.plan) == hash(plan)
    assert ff.scan(plan, files) == stats
    # Another sample, other coordinates.
    assert ff.Plan(fleet.SHARED, files[:1], chunk_rows=40) != plan


def test_recipe_is_path_text_or_mapping(tmp_path: Path) -> None:
    data = ff.open(fleet.noisy(80, 0))
    path = tmp_path / "robot.toml"
    text = '[model]\npredict = "y"\n[inputs]\nx = "x"\nz = "z"\n[time]\ncolumn = "t"\n'
    path.write_text(text)
    plans = [ff.Plan(recipe, data) for recipe in (path, str(path), text, fleet.PLAIN)]
    plans.append(ff.Plan(None, ff.open(fleet.noisy(80, 0), recipe=text)))
    assert len(set(plans)) == 1


def test_values_survive_bytes_files_pickles_and_copies(tmp_path: Path, files: list[str], plan: ff.Plan) -> None:
    stats = scanned(plan, files)
    for value in (plan, stats):
        for again in (
            type(value).from_bytes(value.to_bytes()),
            pickle.loads(pickle.dumps(value)),
            copy.copy(value),
            copy.deepcopy(value),
        ):
            assert again == value and hash(again) == hash(value) and again.to_bytes() == value.to_bytes()
        path = tmp_path / "value.stats"
        value.save(path)
        value.save(path)
        assert type(value).load(path) == value and path.read_bytes() == value.to_bytes()
    assert stats != plan and stats != 0 and [path.name for path in tmp_path.glob("*.stats*")] == ["value.stats"]


def test_damaged_and_foreign_bytes_are_refused(tmp_path: Path, files: list[str], plan: ff.Plan) -> None:
    good = bytearray(scanned(plan, files).to_bytes())
    for at in (9, len(good) // 2, len(good) - 1):
        bad = bytearray(good)
        bad[at] ^= 0x40
        with pytest.raises(StatisticError):
            ff.Stats.from_bytes(bytes(bad))
    with pytest.raises(StatisticError, match="not a statistic of fleetfoot"):
        ff.Stats.from_bytes(b"PAR1" * 40)
    with pytest.raises(StatisticError, match="damaged"):
        ff.Stats.from_bytes(bytes(good[:-7]))
    with pytest.raises(StatisticError, match="cannot be read"):
        ff.Stats.load(tmp_path / "missing.stats")
    with pytest.raises(WriteError):
        scanned(plan, files).save(tmp_path / "no folder" / "a.stats")
    with pytest.raises(OSError):
        scanned(plan, files).save(tmp_path / "no folder" / "a.stats")
    with pytest.raises(TypeError, match="fleetfoot.scan"):
        ff.Stats()


def test_parts_add_up_in_any_order(files: list[str], plan: ff.Plan) -> None:
    whole = scanned(plan, files)
    parts = [scanned(plan, [file]) for file in files]
    assert sum(parts) == whole == sum(reversed(parts))
    assert ff.merge(parts) == ff.merge(parts[::-1]) == (parts[2] + parts[0]) + (parts[3] + parts[1])
    assert whole.to_bytes() == ff.merge(parts[1:] + parts[:1]).to_bytes()
    assert whole.rows == (sum(part.rows.complete for part in parts), 0, 0)
    assert whole.chunks == sum(part.chunks for part in parts)


def test_a_log_never_counts_twice(tmp_path: Path, files: list[str], plan: ff.Plan) -> None:
    whole = scanned(plan, files)
    with pytest.raises(StatisticError, match="same log.*flight_1.csv"):
        whole + scanned(plan, files[1:2])
    same = str(fleet.write(tmp_path / "again.csv", fleet.run(95, 10.0)))
    with pytest.warns(UserWarning, match="the same content as|the same rows as"):
        twice = scanned(plan, [*files, same])
    assert [e.id for e in twice.episodes] == [e.id for e in whole.episodes] and twice.rows == whole.rows


def test_other_plans_do_not_add(files: list[str], plan: ff.Plan) -> None:
    stats = ff.scan(plan, files[:1])
    wider = ff.scan(fleet.SHARED.replace("degree = 2", "degree = 3"), files[1:], chunk_rows=40)
    with pytest.raises(StatisticError, match=r"x\^3"):
        stats + wider
    with pytest.raises(StatisticError, match="other coordinates"):
        stats + ff.scan(fleet.SHARED, files[1:], chunk_rows=40)
    with pytest.raises(TypeError):
        stats + 1  # type: ignore[operator]
    with pytest.raises(TypeError, match=r"statistics\[1\] is a int"):
        ff.merge([stats, 3])  # type: ignore[list-item]
    with pytest.raises(ValueError, match="statistics is empty"):
        ff.merge([])


def test_episodes_name_their_source(files: list[str], plan: ff.Plan) -> None:
    stats = scanned(plan, files)
    by_file = {episode.file: episode for episode in stats.episodes}
    assert sorted(by_file) == sorted(files) == sorted(stats.files)
    first = by_file[files[0]]
    assert first.labels == {"aircraft": "1"} and first.rows == first.complete == 95
    assert first.start == 0 and first.end == 940_000_000 and first.period == pytest.approx(0.01)
    # Two files share a name, so that the path tells them apart.
    assert first.name == files[0]


def test_selection_equals_its_scan(files: list[str], plan: ff.Plan) -> None:
    stats = scanned(plan, files)
    record = next(episode for episode in stats.episodes if episode.file == files[0])
    alone = scanned(plan, files[:1])
    for one in (record, record.name, record.id, record.id[:10].upper(), [record], lambda e: e.file == files[0]):
        assert stats.select(one) == alone
        assert stats.drop(one) == scanned(plan, files[1:])
    assert stats.select(where={"aircraft": 2}) == stats.drop(where={"aircraft": ["1"]}) == scanned(plan, files[2:])
    assert stats.select(where={"aircraft": ["1", "2"]}) == stats
    assert stats.select(lambda e: e.rows < 110, where={"aircraft": "2"}).episodes[0].rows == 100
    assert stats.drop(record) + stats.select(record) == stats


def test_empty_selection_lists_episodes(files: list[str], plan: ff.Plan) -> None:
    stats = scanned(plan, files)
    with pytest.raises(StatisticError, match="'flight_7.csv' matches no episode; there is .*flight_0.csv"):
        stats.select("flight_7.csv")
    with pytest.raises(StatisticError, match="aircraft = '9' matches no episode; of values there is 1, 2"):
        stats.drop(where={"aircraft": 9})
    with pytest.raises(StatisticError, match="of labels there is aircraft"):
        stats.select(where={"plane": 1})
    with pytest.raises(StatisticError, match="keys="):
        ff.scan(plan, files).select(where={"aircraft": 1})
    with pytest.raises(StatisticError, match="none of the 4 episodes"):
        stats.drop(lambda _: True)
    with pytest.raises(ValueError, match="neither episodes nor where"):
        stats.select()
    with pytest.raises(TypeError, match="episodes has a int"):
        stats.select([3])  # type: ignore[list-item]


def test_compaction_keeps_the_totals(files: list[str], plan: ff.Plan) -> None:
    stats = scanned(plan, files)
    small = stats.compact()
    assert small.chunks == len(stats.episodes) < stats.chunks and small.rows == stats.rows
    assert np.allclose(small.solve().coefficients, stats.solve().coefficients, rtol=1e-12, atol=1e-12)


def test_the_gram_matrix_is_that_of_the_rows() -> None:
    runs = [fleet.noisy(300, 1), fleet.noisy(200, 2)]
    gram = ff.scan(fleet.PLAIN, runs).gram()
    x, y = matrix(runs)
    order = [gram.names.index(name) for name in ("1", "x", "z")]
    assert gram.target == "y" and gram.weight == len(y)
    assert np.allclose(gram.xtx[np.ix_(order, order)], x.T @ x, rtol=1e-12)
    assert np.allclose(gram.xty[order], x.T @ y, rtol=1e-12) and gram.yty == pytest.approx(y @ y, rel=1e-12)


def test_gram_names_the_task(files: list[str], plan: ff.Plan) -> None:
    stats = scanned(plan, files)
    assert stats.gram("normal").target == stats.gram(1).target == "b"
    with pytest.raises(StatisticError, match="several: along, normal"):
        stats.gram()
    with pytest.raises(StatisticError, match="there is no task 'lift': along, normal"):
        stats.gram("lift")


def test_least_squares_is_that_of_the_rows() -> None:
    runs = [fleet.noisy(300, 1), fleet.noisy(200, 2)]
    x, y = matrix(runs)
    expected, *_ = np.linalg.lstsq(x, y, rcond=None)
    solution = ff.scan(fleet.PLAIN, runs, chunk_rows=10).solve()
    assert [solution.as_dict()["f_y"][name] for name in ("1", "x", "z")] == pytest.approx(list(expected), rel=1e-11)
    residual = y - x @ expected
    assert solution.tasks["y"].rms == pytest.approx(np.sqrt(np.mean(residual**2)), rel=1e-9)
    assert solution.tasks["y"].r2 == pytest.approx(1 - residual.var() / y.var(), rel=1e-9)
    assert solution.certificate.kkt < 1e-12 and solution.rows == 500
    # Rows are independent here, and so the clustered errors are near the classical ones.
    classical = np.sqrt(np.diag(np.linalg.inv(x.T @ x)) * residual.var())
    errors = dict(zip(solution.names, solution.standard_errors, strict=True))
    assert [errors[f"f_y: {name}"] for name in ("1", "x", "z")] == pytest.approx(list(classical), rel=0.5)


@pytest.mark.parametrize(
    ("method", "alpha", "l1_ratio"),
    [("lasso", 0.2, None), ("lasso", 0.01, None), ("ridge", 0.3, None), ("elastic-net", 0.1, 0.4)],
)
def test_penalised_solutions_are_scikit_learns(method: str, alpha: float, l1_ratio: float | None) -> None:
    linear = pytest.importorskip("sklearn.linear_model", reason="scikit-learn is the peer")
    runs = [fleet.noisy(300, 1), fleet.noisy(200, 2)]
    x, y = matrix(runs)
    columns, size = (x[:, 1:] - x[:, 1:].mean(0)) / x[:, 1:].std(0), y.std()
    target = (y - y.mean()) / size
    if method == "ridge":
        peer = linear.Ridge(alpha=alpha * len(y), tol=1e-14, solver="cholesky")
    else:
        ratio = 1.0 if l1_ratio is None else l1_ratio
        peer = linear.ElasticNet(alpha=alpha, l1_ratio=ratio, tol=1e-14, max_iter=100_000)
    expected = peer.fit(columns, target).coef_ * size / x[:, 1:].std(0)
    solution = ff.scan(fleet.PLAIN, runs).solve(method, alpha, l1_ratio=l1_ratio)
    values = solution.as_dict()["f_y"]
    assert [values["x"], values["z"]] == pytest.approx(list(expected), rel=1e-9, abs=1e-9)
    assert values["1"] == pytest.approx(y.mean() - expected @ x[:, 1:].mean(0), rel=1e-9)
    assert solution.certificate.gap < 1e-10 and solution.standard_errors is None and solution.method == method


def test_shared_latents_are_solved_together(files: list[str], plan: ff.Plan) -> None:
    solution = scanned(plan, files).solve()
    values = solution.as_dict()
    assert values["T"] == pytest.approx({"1": 3.0, "x": 1.0, "x^2": -0.5}, abs=1e-9)
    assert values["D"] == pytest.approx({"v": 0.7, "v^2": 0.0}, abs=1e-9)
    assert solution.names == ["T: 1", "T: x", "T: x^2", "D: v", "D: v^2"]
    assert '"T"' in solution.to_json()


def test_solve_accepts_settings_outside_the_sums(files: list[str], plan: ff.Plan) -> None:
    stats = scanned(plan, files)
    free = stats.solve("lasso", 0.5)
    unpenalised = stats.solve("lasso", 0.5, recipe=fleet.SHARED.replace("degree = 2", "degree = 2, penalty = 0.0"))
    assert free.as_dict()["T"]["x^2"] != pytest.approx(-0.5, abs=1e-3)
    assert unpenalised.as_dict()["T"]["x^2"] != free.as_dict()["T"]["x^2"]
    with pytest.raises(StatisticError, match=r"x\^3"):
        stats.solve(recipe=fleet.SHARED.replace("degree = 2", "degree = 3"))


@pytest.mark.parametrize(
    ("arguments", "options", "error", "words"),
    [
        (("newton",), {}, ValueError, "least-squares, ridge, lasso, elastic-net"),
        (("lasso",), {}, ValueError, "alpha is not given"),
        (("least-squares", 1.0), {}, ValueError, "has no penalty"),
        (("ridge", 1.0), {"l1_ratio": 0.5}, ValueError, "ridge has its own"),
        (("elastic-net", 1.0), {}, ValueError, "l1_ratio is not given"),
        (("lasso", -1.0), {}, RequestError, "lambda = -1"),
        (("elastic-net", 1.0), {"l1_ratio": 1.5}, RequestError, "l1_ratio = 1.5"),
    ],
)
def test_wrong_solves_are_refused(
    arguments: tuple[object, ...], options: dict[str, object], error: type[Exception], words: str
) -> None:
    stats = ff.scan(fleet.PLAIN, fleet.noisy(60, 0))
    with pytest.raises(error, match=words):
        stats.solve(*arguments, **options)  # type: ignore[arg-type]


def test_wrong_scans_are_refused(tmp_path: Path, files: list[str], plan: ff.Plan) -> None:
    with pytest.raises(RequestError, match="not_there|nothing|y"):
        ff.scan({"model": {"predict": "not_there"}, "inputs": {"x": "x"}}, files)
    with pytest.raises(RequestError, match="--key|NAME=TEXT"):
        ff.scan(plan, files, keys="aircraft")
    with pytest.raises(ValueError, match="chunk_rows: the plan has its own"):
        ff.scan(plan, files, chunk_rows=7)
    with pytest.raises(RequestError, match="chunk_rows=0"):
        ff.scan(fleet.SHARED, files, chunk_rows=0)
    with pytest.raises(DataError):
        ff.scan(plan, str(tmp_path / "missing.csv"))
    hollow = fleet.run(40, 0.0) | {"v": np.full(40, np.nan)}
    with pytest.raises(RequestError, match="no row can be used"):
        ff.scan(plan, hollow)


def test_tables_and_files_have_equal_sums(tmp_path: Path, files: list[str], plan: ff.Plan) -> None:
    runs = [fleet.run(90 + 17 * flight + 5 * number, 10.0 * number + flight) for number in (1, 2) for flight in (0, 1)]
    from_files, from_arrays = ff.scan(plan, files), ff.scan(plan, runs)
    assert [e.id for e in from_files.episodes] == [e.id for e in from_arrays.episodes]
    assert from_files.gram(0).xtx.tobytes() == from_arrays.gram(0).xtx.tobytes()
    assert from_files.solve().coefficients.tobytes() == from_arrays.solve().coefficients.tobytes()


def test_the_statistic_of_no_rows_is_a_clear_error(plan: ff.Plan, files: list[str]) -> None:
    empty = ff.Stats.from_bytes(plan.to_bytes())
    assert empty.rows == (0, 0, 0) and empty.episodes == [] and empty.files == [] and empty.compact() == empty
    assert ff.scan(plan, files[:1]) + empty == ff.scan(plan, files[:1])
    with pytest.raises(RequestError, match="no rows"):
        empty.solve()
    with pytest.raises(RequestError, match="no rows"):
        empty.solve("lasso", 0.1)
    with pytest.raises(StatisticError, match="no rows"):
        empty.gram(0)
    with pytest.raises(StatisticError, match="none of the 0 episodes"):
        empty.drop(lambda _: True)
    for estimator in (ff.BlockSparse(), ff.SINDy()):
        with pytest.raises((RequestError, StatisticError)):
            estimator.fit(empty)


def test_a_solution_is_a_model() -> None:
    runs = [fleet.noisy(300, 1), fleet.noisy(200, 2)]
    solution = ff.scan(fleet.PLAIN, runs).solve()
    values = solution.as_dict()["f_y"]
    model = solution.model
    assert model.to_json() == solution.to_json() and model.method == "statistic least squares"
    names = model.get_feature_names()
    assert dict(zip(names, model.coefficients().ravel(), strict=True)) == pytest.approx(values, rel=1e-15)


@pytest.mark.filterwarnings("ignore::fleetfoot.FleetfootWarning")
def test_statistic_fits_like_its_logs() -> None:
    t = np.arange(600) * 0.01
    run = {"t": t, "x": np.cos(2 * t), "v": -2 * np.sin(2 * t)}
    # A statistic has differences of order 2; logs would choose a higher one.
    states = {"x": {"derivative": "central"}, "v": {"derivative": "central"}}
    recipe = {"states": states, "time": {"column": "t"}, "model": {"degree": 2}}
    stats = ff.scan(recipe, run, chunk_rows=20)
    from_stats, from_rows = ff.SINDy(threshold=0.1).fit(stats), ff.SINDy(threshold=0.1, recipe=recipe).fit(run)
    assert from_stats.equations() == from_rows.equations()
    shared = ff.scan(fleet.SHARED, fleet.run(400, 1.0), chunk_rows=20)
    fitted = ff.BlockSparse(recipe=fleet.SHARED).fit(shared)
    thrust = dict(zip(fitted.get_feature_names("T"), fitted.coefficients(latent="T"), strict=True))
    assert thrust == pytest.approx({"1": 3.0, "x": 1.0, "x^2": -0.5}, abs=1e-6)


def test_equations_and_regions_are_fitted_without_the_logs() -> None:
    t = 0.01 * np.arange(900)
    runs = [{"t": t, "x": np.sin(t + k), "y": np.abs(np.sin(t + k)) + 0.01 * np.cos(31 * t)} for k in range(4)]
    model = {"predict": "y", "partition": "average,kmeans:2", "partition_on": ["x"]}
    recipe = {"model": model, "inputs": {"x": "x"}, "time": {"column": "t"}}
    plan = ff.Plan(recipe, runs)
    whole = ff.scan(plan, runs)
    parts = [ff.scan(plan, ff.open(run, name=f"run {k}")) for k, run in enumerate(runs)]
    assert sum(parts) == whole
    methods = [text.split(" (")[0] for text in whole.serves]
    assert methods == ["fit sparse", "fit sindy", "fit pwa"] and "kmeans:2" in whole.serves[2]
    for method in (lambda: ff.PWA(partition=[2]), lambda: ff.SINDy(partition="kmeans:2")):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from_parts, from_whole, from_logs = (
                method().fit(given).model_ for given in (sum(parts), whole, ff.open(runs, recipe=recipe))
            )
        assert from_parts == from_whole
        assert len(from_whole.regions) == 2
        for region in range(2):
            there, here = from_logs.coefficients(region=region), from_whole.coefficients(region=region)
            assert np.allclose(there, here, rtol=1e-9, atol=1e-12)
    with pytest.raises(NeedsLogsError, match=r"kmeans:3.*scan again"):
        ff.PWA(partition=3).fit(whole)
    with pytest.raises(NeedsLogsError, match=r"x\^3.*scan again"):
        ff.SINDy(library="poly(3)", partition="average").fit(whole)
