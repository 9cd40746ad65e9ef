"""Filters of recordings by a model."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from . import _core as engine
from . import _recipe
from ._progress import Progress, reporting
from ._tables import Filtered
from ._values import names_of
from ._warnings import tell_all

#: States, or states with the deviations of their sensors.
Measured = Sequence[str] | Mapping[str, float | None]


class Filtering:
    """Estimates of a model from noisy measurements."""

    __slots__ = ()

    _core: engine.Model

    def filter(
        self,
        data: Any,
        *,
        measured: Measured | None = None,
        sensors: Mapping[str, str] | None = None,
        truth: Mapping[str, str] | None = None,
        initial: Mapping[str, tuple[float, float]] | None = None,
        process: float | Literal["auto"] | None = None,
        noise: Literal["auto", "white", "coloured"] | None = None,
        switching: Literal["state", "transitions"] | None = None,
        keep: bool = False,
        output: str | os.PathLike[str] | None = None,
        recipe: str | os.PathLike[str] | Mapping[str, Any] | None = None,
        cache: str | os.PathLike[str] | None = None,
        progress: Progress = None,
    ) -> Filtered:
        """Estimates states row by row from noisy measurements of some of them.

        Every region has a Kalman filter whose process noise is the residual covariance of the region. If residuals
        are correlated from row to row, so is the noise. An estimate does not depend on later rows.

        Parameters
        ----------
        data : anything that :func:`fleetfoot.open` takes
            Recordings.
        measured : list or mapping, optional
            Measured states, with the standard deviations of their sensors. A deviation of ``None`` comes from the
            column ``NAME_deviation`` of the recording, else from the innovations. Default: all states in the
            recording.
        sensors : mapping, optional
            Field or expression of the recording that measures a state.
        truth : mapping, optional
            Field of the recording with the true state, for the errors of the estimates.
        initial : mapping, optional
            Mean and standard deviation of states before their first measurement; default: those of the training.
        process : float or "auto", optional
            Factor on the process noise (default 1); ``"auto"`` estimates it from the innovations.
        noise : {"auto", "white", "coloured"}, optional
            Correlation of the process noise from row to row. ``"auto"``, the default, uses it if the model's
            residuals are correlated.
        switching : {"state", "transitions"}, optional
            Rule by which one region follows another: by the region of the state, or by the transitions counted in
            training.
        keep : bool
            Return the estimates.
        output : path, optional
            File for the estimates, Parquet, text or MCAP; they are then not returned.
        recipe, cache, progress : optional
            As for :meth:`predict`; arguments override ``[filter]`` of a recipe.

        Returns
        -------
        dict
            ``sensors`` (``state``, ``deviation`` and its source, ``share`` of the innovations in their 95 % band,
            ``correlation`` with the previous row and its size by chance, ``white``), ``nis`` and, with a truth,
            ``nees`` (``mean`` per degree of freedom, its 95 % band ``low`` and ``high``, ``share``), ``truth``
            (``rmse``, ``measured_rmse``), ``log_likelihood``, ``process``, ``noise_rows``, ``notes``; and with
            ``keep`` ``estimates``: for each episode a dict of ``episode``, ``t``, ``x`` and ``deviation`` (rows,
            states), ``probability`` (rows, regions), ``region``, ``innovation``, ``innovation_deviation`` (rows,
            sensors), ``log_likelihood``.

        Raises
        ------
        DataError, RequestError, ModelError

        Examples
        --------
        >>> import numpy as np, fleetfoot as ff
        >>> t, random = np.arange(0, 20, 0.01), np.random.default_rng(0)
        >>> v = 0.1 * np.cumsum(random.normal(size=t.size))
        >>> x = np.cumsum(np.append(0, v[:-1])) * 0.01
        >>> mass = ff.PWA(target="next").fit(np.column_stack([x, v]), t, feature_names=["x", "v"]).model_
        >>> rows = {"t": t, "x": x + 0.05 * random.normal(size=t.size), "true_v": v}
        >>> found = mass.filter(rows, measured={"x": 0.05}, truth={"v": "true_v"}, keep=True)
        >>> found["estimates"][0]["x"].shape, bool(found["truth"][0]["rmse"] < 0.5 * v.std())
        ((2000, 2), True)
        """
        entries = _filter_entries(measured, sensors, truth, initial, process, noise, switching)
        opened, changes = self._opened(data, recipe, arguments={"filter": entries} if entries else {})  # type: ignore[attr-defined]
        written = None if output is None else os.fspath(output)
        with reporting(progress) as callback:
            result, estimates = engine.filter(self._core, opened, changes, keep, written, cache, callback)
        report = Filtered(result)
        if keep and output is None:
            report["estimates"] = estimates
        report["notes"] = tell_all(report["notes"])
        return report

    def export_filter(
        self,
        folder: str | os.PathLike[str] = ".",
        *,
        measured: Mapping[str, float] | None = None,
        initial: Mapping[str, tuple[float, float]] | None = None,
        process: float | None = None,
        noise: Literal["auto", "white", "coloured"] | None = None,
        switching: Literal["state", "transitions"] | None = None,
        prefix: str = "model",
        precision: Literal["double", "float"] = "double",
    ) -> list[str]:
        """Writes the filter of a model with affine regions as C: ``PREFIX_filter.h`` and ``PREFIX_filter.c``.

        Parameters
        ----------
        folder : path
            Folder of the files, created if necessary.
        measured, initial, process, noise, switching : optional
            As for :meth:`filter`; every sensor needs a deviation.
        prefix : str
            Prefix of all names, and name of the files.
        precision : {"double", "float"}
            Numbers.

        Returns
        -------
        list of str
            The files.

        Raises
        ------
        RequestError
            A sensor without a deviation, regions that are not affine.
        """
        entries = _filter_entries(measured, None, None, initial, process, noise, switching)
        files = engine.export_filter(
            self._core, _recipe.to_json({"filter": entries}), os.fspath(folder), prefix, precision
        )
        return [os.fspath(file) for file in files]


def _filter_entries(
    measured: Measured | None,
    sensors: Mapping[str, str] | None,
    truth: Mapping[str, str] | None,
    initial: Mapping[str, tuple[float, float]] | None,
    process: float | str | None,
    noise: str | None,
    switching: str | None,
) -> dict[str, Any]:
    """Arguments as entries of a recipe."""

    def fields(named: Mapping[str, str] | None) -> str | None:
        return None if named is None else ",".join(f"{name}={field}" for name, field in named.items())

    if isinstance(measured, Mapping):
        sure = [name if deviation is None else f"{name}={float(deviation)!r}" for name, deviation in measured.items()]
    else:
        sure = [] if measured is None else names_of(measured)
    starts = (initial or {}).items()
    return _recipe.without_none(
        measured=None if measured is None else ",".join(sure),
        sensors=fields(sensors),
        truth=fields(truth),
        initial=None if initial is None else ",".join(f"{n}={float(m)!r}:{float(d)!r}" for n, (m, d) in starts),
        process=process if process is None or isinstance(process, str) else float(process),
        noise=noise,
        switching=switching,
    )
