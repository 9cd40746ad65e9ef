"""Models on recordings: predictions row by row, scores, rollouts."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from . import _core as engine
from . import _recipe
from ._arrays import floats, numbers, period_seconds, since_first
from ._controller import Controller, what
from ._data import in_unit
from ._data import open as open_data
from ._equations import Content
from ._frames import CLOCKS, Frame, frame, in_order, runs_in_order, slopes_in_order
from ._keywords import hinting
from ._numbers import seconds
from ._progress import Progress, reporting
from ._runs import is_arrays, runs
from ._tables import Rollouts, Scores
from ._values import count, names_of, number
from ._warnings import tell_all
from .exceptions import DataError, ModelError, RequestError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


class OnRecordings:
    """Methods of a model on recordings: files, tables, data sets, arrays."""

    __slots__ = ()

    _core: engine.Model
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    lags: int
    uses_time: bool
    dt: float

    @property
    def content(self) -> Content:
        """Content of the model's file."""
        raise NotImplementedError

    def predict(
        self,
        x: Any,
        u: ArrayLike | None = None,
        t: ArrayLike | None = None,
        *,
        recipe: str | os.PathLike[str] | Mapping[str, Any] | None = None,
        cache: str | os.PathLike[str] | None = None,
        progress: Progress = None,
    ) -> Any:
        """Predictions of the fitted equations for every row.

        Parameters
        ----------
        x : array, or anything that :func:`fleetfoot.open` takes
            The states of consecutive rows, (rows, states), with ``u``, (rows, inputs); or a data set, files, a table.
            ``None`` for a model without states.
        u : array, optional
            Inputs.
        t : array, optional
            Seconds since the start, for models that depend on time.
        recipe : optional
            Entries that differ for these files: ``[time]``, ``[files]``, ``[rename]``, ``[episodes]``.
        cache : path, optional
            Folder for the decoded columns of robots' logs.
        progress : bool or callable, optional
            ``True`` for a bar.

        Returns
        -------
        array, table or dict
            Arrays (rows, outputs) for arrays, a table of the same kind (pandas, polars, pyarrow, xarray) for a table,
            a list for a list of runs. Rows without the required past are NaN. For data sets a dict: ``targets`` and
            ``episodes`` (names), ``episode`` (index of each row's), ``stamp`` (ns), ``measured``, ``predicted`` and
            ``residual`` (rows, targets), ``region`` (-1: none), ``distance`` (from the region's mean, Mahalanobis),
            ``complete`` (target and prediction exist), ``domain`` (0 within the training range of the region, 1
            outside it, 2 outside that of all regions).

        Raises
        ------
        ModelError, DataError, RequestError
        """
        if isinstance(x, (list, tuple)) and any(isinstance(run, np.ndarray) or frame(run) is not None for run in x):
            us, ts = (_of_runs(beside, len(x), what) for beside, what in ((u, "u"), (t, "t")))
            how: dict[str, Any] = {"recipe": recipe, "cache": cache, "progress": progress}
            return [self.predict(*run, **how) for run in zip(x, us, ts)]
        table = frame(x)
        if table is not None:
            return self._predict_table(table, x, u, t, recipe, cache, progress)
        if x is None or is_arrays(x):
            if u is not None:
                u = in_order(u, self.inputs, "u")
            return self._core.fitted(x, u, None if t is None else since_first(t, "t"))[0]
        data, changes = self._opened(x, recipe)
        with reporting(progress) as callback:
            return engine.predict_rows(self._core, data, changes, cache, callback)

    def _predict_table(
        self, table: Frame, x: Any, u: Any, t: Any, recipe: Any, cache: Any, progress: Progress
    ) -> Any:
        """Predictions of a table's rows, as a table of its kind."""
        beside = frame(u)
        columns = {name: table.column for name in table.names}
        columns.update({name: beside.column for name in beside.names} if beside is not None else {})
        wanted = (*self.states, *(self.inputs if u is None or beside is not None else ()))
        # A table alone says by its clock where rows follow each other, beside inputs all its rows do.
        goes_by_rows = bool(self.lags or self._core.ahead())
        if all(name in columns for name in wanted) and (not goes_by_rows or u is not None):
            rows = _beside(columns, self.states, table.rows)
            given = _beside(columns, self.inputs, table.rows) if u is None or beside is not None else u
            fitted = self._core.fitted(rows, given, _seconds(table, t) if self.uses_time else None)[0]
        elif u is not None:
            missing = next(name for name in wanted if name not in columns)
            raise ModelError(f"the table has no column `{missing}`; it has {', '.join(columns)}")
        else:
            data, changes = self._opened(x, recipe, t if isinstance(t, str) else None)
            with reporting(progress) as callback:
                fitted = engine.predict_rows(self._core, data, changes, cache, callback)["predicted"]
            if len(fitted) != table.rows:
                raise DataError(
                    f"{table.rows - len(fitted)} of {table.rows} rows of the table have no stamp that can be read; "
                    "leave them out, or predict of fleetfoot.open(table)"
                )
        return table.made(self.outputs, fitted)

    def score(
        self,
        x: Any,
        t: Any = None,
        x_dot: Any = None,
        u: Any = None,
        *,
        dt: float | None = None,
        columns: Mapping[str, Any] | None = None,
        recipe: str | os.PathLike[str] | Mapping[str, Any] | None = None,
        cache: str | os.PathLike[str] | None = None,
        progress: Progress = None,
    ) -> Scores:
        """One-step errors on a recording, beside the null model, persistence and constant velocity.

        Parameters
        ----------
        x : array, list of arrays, or anything that :func:`fleetfoot.open` takes
            Runs as for :meth:`fleetfoot.SINDy.fit`, or files, tables, data sets.
        t, x_dot, u, dt, columns : optional
            As for :meth:`fleetfoot.SINDy.fit`, beside arrays. ``x_dot`` is required if the fit had it.
        recipe, cache, progress : optional
            As for :meth:`predict`.

        Returns
        -------
        dict
            ``targets``: for each fitted equation its errors (``mae``, ``rmse``, ``r2``, ``mae_over_null`` with 95 %
            intervals), the ``baselines``, and for prepared logs with available raw logs ``raw`` (``rows``, ``mae``,
            ``rmse`` against the measurements); ``by_episode``; ``in_sample_episodes``, names of training episodes;
            ``rows``, ``skipped``, ``mahalanobis``, ``calibration``, ``notes``.

        Raises
        ------
        DataError, RequestError, ModelError

        Warns
        -----
        FleetfootWarning
            Assumptions about the data. Training episodes are not a warning; they are in ``in_sample_episodes``.
        """
        if is_arrays(x):
            core, data, changes = self._arrays(x, t, x_dot, u, dt, columns)
        else:
            core = self._core
            data, changes = self._opened(x, recipe, t, dt)
        with reporting(progress) as callback:
            report = Scores(engine.score(core, data, changes, cache, callback))
        report["notes"] = tell_all(report["notes"])
        return report

    @hinting
    def rollout(
        self,
        data: Any,
        horizon: int,
        *,
        starts: int | Sequence[tuple[int, int]] = 1000,
        seed: int | None = None,
        method: Literal["rk4", "euler"] = "rk4",
        dt: float | None = None,
        controller: Controller | str | os.PathLike[str] | None = None,
        settings: Mapping[str, Any] | None = None,
        outside: Literal["tell", "end", "hold"] = "tell",
        position: Sequence[str] = (),
        reference: Mapping[str, str] | None = None,
        interval: int = 1,
        band: int | None = None,
        keep: bool = False,
        recipe: str | os.PathLike[str] | Mapping[str, Any] | None = None,
        cache: str | os.PathLike[str] | None = None,
        progress: Progress = None,
    ) -> Rollouts:
        """Simulations from measured states, scored by horizon beside the baselines. Inputs come from the recording or
        a controller.

        Parameters
        ----------
        data : anything that :func:`fleetfoot.open` takes
            Recordings.
        horizon : int
            Steps ahead.
        starts : int or list of (episode, row)
            Number of starts, evenly spread or, with ``seed``, random; or a list of starts.
        seed : int, optional
            Seed of random starts.
        method : {"rk4", "euler"}
            Integration of derivatives.
        dt : float, optional
            Length of a step, seconds; default: the recording's period.
        controller : Controller, str or path, optional
            Controller that closes the loop: the result of :meth:`Model.lqr` or its file, ``"treadmill"``, or a TOML
            file.
        settings : mapping, optional
            Settings of the controller.
        outside : {"tell", "end", "hold"}
            Rule for a regressor outside the training range of its region: the trajectory continues, ends, or
            continues with the regressor held at the limit.
        position : list of str
            States of one unit whose path is compared with the recorded one: distance, direction, relative growth of
            the distance, time warping.
        reference : mapping, optional
            A baseline: states that follow a column or expression at once, or whose rate does:
            ``{"vx": "vx_ref", "d(x)/dt": "vx_ref"}``.
        interval : int
            Steps over which the relative growth of the distance is taken.
        band : int, optional
            Steps by which time warping may shift a point; default: a tenth of the horizon.
        keep : bool
            Return the trajectories.
        recipe, cache, progress : optional
            As for :meth:`predict`.

        Returns
        -------
        dict
            ``time`` (horizon), ``states``, ``replayed`` (columns from the recording after a start), ``model`` and
            ``baselines`` (``rmse``, ``mae``: horizon x states; ``mahalanobis`` and ``displacement`` with intervals;
            ``summary`` and ``displacement_summary``: ``average``, ``last``, ``drift_per_second`` over whole
            rollouts; ``path``: ``alignment`` by step, ``average_alignment``, ``propagated_error``,
            ``warping_distance``; ``orientation``: cosine of the errors of angles; ``explained_variance`` of each
            state), ``beside_reference`` (the model's paths beside the reference's), ``raw`` for prepared logs with available raw logs (``rmse``, ``mae`` against the measurements),
            ``useful_horizon`` (``better_than_all`` and, by baseline, ``better_than``: the spans of steps in which the
            model is better), ``diverged``, ``left_domain``, ``ended_outside``, ``notes``; and with ``keep``
            ``trajectories``: for each start a dict of ``episode``, ``row``, ``t``, ``x`` (steps + 1, states), ``u``
            (steps, inputs of the controller), ``region``, ``end``.

        Raises
        ------
        DataError, RequestError, ModelError
        """
        opened, changes = self._opened(data, recipe)
        at = [] if np.ndim(starts) == 0 else [_start(*start) for start in starts]  # type: ignore[union-attr]
        request = {
            "horizon": count("horizon", horizon, 1),
            "count": count("starts", starts, 1) if np.ndim(starts) == 0 else 0,
            "seed": None if seed is None else count("seed", seed, 0),
            "at": at,
            "method": method,
            "dt": None if dt is None else number("dt", period_seconds(dt, "dt")),
            "keep": bool(keep),
            "outside": outside,
            "position": names_of(position),
            "reference": [f"{state}={of}" for state, of in (reference or {}).items()],
            "interval": count("interval", interval, 1),
            "band": None if band is None else count("band", band, 0),
            "controller": what(controller),
            "settings": [f"{name}={value}" for name, value in (settings or {}).items()],
        }
        with reporting(progress) as callback:
            result, trajectories = engine.rollout(self._core, opened, changes, request, cache, callback)
        report = Rollouts(result)
        if keep:
            report["trajectories"] = trajectories
        report["notes"] = tell_all(report["notes"])
        return report

    def resimulate(
        self,
        data: Any,
        *,
        every: int | None = None,
        free: Sequence[str] | None = None,
        deviations: Mapping[str, float] | None = None,
        bounds: Mapping[str, tuple[float | None, float | None]] | None = None,
        widen: float | None = None,
        iterations: int | None = None,
        keep: bool = False,
        recipe: str | os.PathLike[str] | Mapping[str, Any] | None = None,
        cache: str | os.PathLike[str] | None = None,
        progress: Progress = None,
    ) -> dict[str, Any]:
        """States and inputs that obey the model, stay within bounds and follow recordings as closely as possible.

        Every episode is an optimal control problem, solved by collocation and sequential convex programs.

        Parameters
        ----------
        data : anything that :func:`fleetfoot.open` takes
            Recordings.
        every : int, optional
            Interval of the rows that make the grid; default: 1.
        free : list of str, optional
            Inputs that may deviate from the recording; default: all.
        deviations : dict, optional
            Expected deviations of columns, which weigh the deviations; default: the noise of the recordings relative
            to the model.
        bounds : dict, optional
            ``(low, high)`` of states and inputs, ``None`` for an open end; default: the recorded range, widened.
        widen : float, optional
            Share of the recorded range that widens it on both sides; default: 0.25.
        iterations : int, optional
            Largest number of convex programs per episode; default: 50.
        keep : bool
            Return the trajectories.
        recipe, cache, progress : optional
            As for :meth:`predict`; arguments override ``[resimulate]`` of a recipe.

        Returns
        -------
        dict
            ``columns`` (for each state and input ``name``, ``kind``, ``deviation``, ``bounds``, ``spread``, and root
            mean square deviations over the episodes, ``followed`` and ``open_loop``: ``median``, ``ninth``,
            ``worst``), ``violation`` and ``stationarity`` (the certificate), ``episodes`` with the same of each,
            ``replayed``, ``warnings``, ``notes``; and with ``keep`` ``trajectories``: for each episode a dict of
            ``episode``, ``row``, ``t``, ``x`` and ``u`` (rows, states or inputs), ``x_measured``, ``u_measured``, and
            ``x_open_loop``, the open-loop simulation with the recorded inputs.

        Raises
        ------
        DataError, RequestError, ModelError, FitError

        Examples
        --------
        >>> import numpy as np, fleetfoot as ff
        >>> t = np.arange(0.0, 10.0, 0.05)
        >>> u = np.sin(t)
        >>> x = np.column_stack([np.cos(1.5 * t), -1.5 * np.sin(1.5 * t)])
        >>> known = {"q": "v", "v": "-k*q + 0.05*u"}
        >>> found = ff.Parameters({"k": 1.0}, known=known).fit(x, t, u=u, feature_names=["q", "v"], input_names=["u"])
        >>> rows = {"t": t, "q": x[:, 0], "v": x[:, 1], "u": u}
        >>> followed = found.model_.resimulate(rows, keep=True)
        >>> bool(followed["violation"]["dynamics"] < 1e-6)
        True
        >>> followed["trajectories"][0]["x"].shape
        (200, 2)
        """
        for name, (low, high) in (bounds or {}).items():
            if low is not None and high is not None and not low < high:
                raise RequestError(f"bounds: {name!r} lies in ({low}, {high}); give (low, high), the smaller number first")
        ends = {name: ["" if end is None else repr(float(end)) for end in two] for name, two in (bounds or {}).items()}
        entries = _recipe.without_none(
            every=None if every is None else count("every", every, 1),
            free=None if free is None else ",".join(f"`{name}`" for name in names_of(free)),
            deviations=None if deviations is None else ",".join(f"`{n}`={float(v)!r}" for n, v in deviations.items()),
            bounds=None if bounds is None else ",".join(f"`{n}`={low}..{high}" for n, (low, high) in ends.items()),
            widen=None if widen is None else float(widen),
            iterations=None if iterations is None else count("iterations", iterations, 1),
        )
        opened, changes = self._opened(data, recipe, arguments={"resimulate": entries} if entries else {})
        with reporting(progress) as callback:
            report, trajectories = engine.resimulate(self._core, opened, changes, cache, callback)
        if keep:
            report["trajectories"] = trajectories
        report["notes"] = tell_all(report["notes"])
        return report

    def _opened(
        self,
        data: Any,
        recipe: Any,
        t: Any = None,
        dt: float | None = None,
        arguments: Mapping[str, Any] | None = None,
    ) -> tuple[engine.Data, str]:
        """The recordings, with clock, topics and episodes of their recipe; the columns are the model's."""
        dataset = open_data(data, t=t, dt=dt)
        changes = _recipe.over(_recipe.of_anything(recipe), _recipe.of_toml(dataset.recipe))
        sections = ("time", "files", "rename", "join", "episodes", "filter", "resimulate")
        kept: dict[str, Any] = {name: changes[name] for name in sections if name in changes}
        kept = _recipe.override(arguments or {}, kept)
        return dataset._core, _recipe.to_json(kept)

    def _arrays(
        self,
        x: Any,
        t: Any,
        x_dot: Any,
        u: Any,
        dt: float | None,
        columns: Mapping[str, Any] | None,
    ) -> tuple[engine.Model, engine.Data, str]:
        """Arrays in the order of states and inputs, and the model over columns of these names."""
        fitted = self.content.fitted()
        known = {column["name"] for column in self.content.columns}
        measured = {one["subject"]: one["target"].strip("`") for one in fitted if one["prediction"] == "derivative"}
        rates = {name: column for name, column in measured.items() if column in known and column not in self.states}
        if rates and x_dot is None:
            names = ", ".join(rates)
            raise ModelError(f"x_dot is missing: the model was fitted to derivatives that were given ({names})")
        given = [name for name in self.inputs if name not in (columns or {})]
        made = runs(
            x,
            t,
            slopes_in_order(x_dot, self.states),
            runs_in_order(u, given, "u"),
            self.states,
            given if u is not None else None,
            columns=columns,
            dt=dt,
            default_dt=self.dt or None,
            derivative_names=rates,
        )
        return self._core.over_named_columns(), made.core, _recipe.to_json({"time": made.time})


def _of_runs(beside: Any, count: int, what: str) -> Sequence[Any]:
    """Further arguments for each run of a list; None for each if absent."""
    if beside is None:
        return [None] * count
    if not isinstance(beside, (list, tuple)) or len(beside) != count:
        raise ModelError(f"x is a list of {count} runs; give a list of as many for {what}")
    return beside


def _start(episode: Any, row: Any) -> tuple[int, int]:
    """Start of a rollout, counted from 0."""
    return count("starts: episode", episode, 0), count("starts: row", row, 0)


def _beside(columns: Mapping[str, Any], names: Sequence[str], rows: int) -> Any:
    """Columns side by side; without columns None, except for a model of constants."""
    values = [floats(columns[name](name), f"column {name!r}") for name in names]
    return np.column_stack(values) if values else np.empty((rows, 0))


def _seconds(table: Frame, t: Any) -> Any:
    """Seconds since the first row, by stamps or by the table's clock."""
    named = t if isinstance(t, str) else next((name for name in CLOCKS if name in table.names), None)
    if t is not None and not isinstance(t, str):
        return since_first(t, "t")
    if table.clock is None and named is None:
        return None
    name, stamps = (named, table.column(named)) if named in table.names else table.clock or ("t", None)
    array = in_unit(name, [numbers(stamps, "t")])[0]
    if array.dtype.kind not in "mM":
        return (array - array[:1]).astype(np.float64)
    there = array[~np.isnat(array)]
    return seconds(array - there[:1] if len(there) else array)
