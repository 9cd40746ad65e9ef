"""Controllers from models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from . import _core, _recipe
from ._arrays import period_seconds
from ._controller import Controller
from ._values import names_of


class Regulated:
    """Control methods of a model."""

    _core: _core.Model

    def lqr(
        self,
        setpoint: Mapping[str, float] | None = None,
        *,
        q: Mapping[str, float] | None = None,
        r: Mapping[str, float] | None = None,
        integral: Mapping[str, float] | None = None,
        limits: Mapping[str, tuple[float, float]] | None = None,
        drive: str | Sequence[str] | None = None,
        free: str | Sequence[str] | None = None,
        period: float | None = None,
        schedule: str | None = None,
    ) -> Controller:
        """Linear-quadratic regulator that keeps the model at a set point, with a law for every region.

        It minimises the sum over samples of ``e'Qe + v'Rv``, with e the error of the states and v that of the inputs.
        Defaults are those of ``[control]`` in the model's recipe; an empty mapping or list restores the built-in
        default.

        Parameters
        ----------
        setpoint : mapping, optional
            Set point of states and inputs; the other values follow from rest.
        q, r : mapping, optional
            Weights of states and inputs; default: one over the variance in training.
        integral : mapping, optional
            Integral action: weights of the time integrals of states' errors.
        limits : mapping, optional
            Lowest and highest values of inputs.
        drive : str or list of str, optional
            Inputs that the regulator drives; default: all. Other inputs are measured and compensated at once.
        free : str or list of str, optional
            States that are neither regulated nor fed back.
        period : float, optional
            Seconds between commands; default: the model's sampling period.
        schedule : {"auto", "region", "mean"}, optional
            Schedule of the laws. ``"auto"``: one per region if a region rests at the set point, else one law of the
            mean of the regions.

        Returns
        -------
        Controller

        Raises
        ------
        ModelError
            Unknown names, invalid weights, unreachable modes, or a model with lags.

        Examples
        --------
        >>> import numpy as np, fleetfoot as ff
        >>> t, random = np.arange(0, 20, 0.01), np.random.default_rng(0)
        >>> u = np.repeat(random.normal(size=40), 50)
        >>> v = np.cumsum(u) * 0.01
        >>> x = np.cumsum(np.append(0, v[:-1])) * 0.01
        >>> mass = ff.PWA(target="next").fit(np.column_stack([x, v]), t, u=u, feature_names=["x", "v"], input_names=["u"]).model_
        >>> controller = mass.lqr({"x": 1.0})
        >>> controller
        Controller(u by x, v; 1 law)
        >>> controller.gains.shape, controller.regions[0]["radius"] < 1
        ((1, 1, 2), True)
        """
        settings = _settings(setpoint, q, r, integral, limits, drive, free, period, schedule)
        return Controller(self._core.control_lqr(_recipe.to_json({"control": settings})))

    def mpc(
        self,
        setpoint: Mapping[str, float] | None = None,
        *,
        horizon: int | None = None,
        bounds: Mapping[str, tuple[float, float]] | None = None,
        q: Mapping[str, float] | None = None,
        r: Mapping[str, float] | None = None,
        integral: Mapping[str, float] | None = None,
        limits: Mapping[str, tuple[float, float]] | None = None,
        drive: str | Sequence[str] | None = None,
        free: str | Sequence[str] | None = None,
        period: float | None = None,
        schedule: str | None = None,
    ) -> Controller:
        """Predictive controller that plans inputs within their limits at every sample.

        It minimises the cost of :meth:`lqr` over the horizon, and ends the plan by the regulator's cost of the last
        state. While no limit and no bound is active, its commands are those of the regulator. The model is linearised
        about the set point, region by region.

        Parameters
        ----------
        setpoint, q, r, integral, limits, drive, free, period, schedule
            Those of :meth:`lqr`.
        horizon : int, optional
            Samples that are planned ahead; default: 20.
        bounds : mapping, optional
            Lowest and highest values of states. Violations are punished, not excluded.

        Returns
        -------
        Controller
            With ``horizon`` and the ``bounds`` of errors in ``law["prediction"]``.

        Raises
        ------
        ModelError
            As :meth:`lqr`; a horizon that is not from 1 to 200, and bounds without the set point.

        Examples
        --------
        >>> import numpy as np, fleetfoot as ff
        >>> t, random = np.arange(0, 20, 0.01), np.random.default_rng(0)
        >>> u = np.repeat(random.normal(size=40), 50)
        >>> v = np.cumsum(u) * 0.01
        >>> x = np.cumsum(np.append(0, v[:-1])) * 0.01
        >>> mass = ff.PWA(target="next").fit(np.column_stack([x, v]), t, u=u, feature_names=["x", "v"], input_names=["u"]).model_
        >>> controller = mass.mpc({"x": 1.0}, horizon=30, limits={"u": (-1, 1)}, bounds={"v": (-0.5, 0.5)})
        >>> controller.law["prediction"]["horizon"]
        30
        """
        settings = _settings(setpoint, q, r, integral, limits, drive, free, period, schedule)
        settings |= _recipe.without_none(
            horizon=None if horizon is None else int(horizon), bounds=None if bounds is None else _ranges(bounds)
        )
        return Controller(self._core.control_mpc(_recipe.to_json({"control": settings})))


def _ranges(named: Mapping[str, tuple[float, float]]) -> str:
    return ",".join(f"{name}={float(low)!r}:{float(high)!r}" for name, (low, high) in named.items())


def _settings(
    setpoint: Mapping[str, float] | None,
    q: Mapping[str, float] | None,
    r: Mapping[str, float] | None,
    integral: Mapping[str, float] | None,
    limits: Mapping[str, tuple[float, float]] | None,
    drive: str | Sequence[str] | None,
    free: str | Sequence[str] | None,
    period: float | None,
    schedule: str | None,
) -> dict[str, Any]:
    """Entries of ``[control]`` that both designs have."""

    def pairs(named: Mapping[str, float] | None) -> str | None:
        return None if named is None else ",".join(f"{name}={float(value)!r}" for name, value in named.items())

    return _recipe.without_none(
        setpoint=pairs(setpoint),
        q=pairs(q),
        r=pairs(r),
        integral=pairs(integral),
        limits=None if limits is None else _ranges(limits),
        drive=None if drive is None else ",".join(names_of(drive)),
        free=None if free is None else ",".join(names_of(free)),
        period=None if period is None else period_seconds(period, "period"),
        schedule=schedule,
    )
