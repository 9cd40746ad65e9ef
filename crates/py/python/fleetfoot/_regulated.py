"""Controllers from models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

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

        def pairs(named: Mapping[str, float] | None) -> str | None:
            return None if named is None else ",".join(f"{name}={float(value)!r}" for name, value in named.items())

        ranges = ",".join(f"{name}={float(low)!r}:{float(high)!r}" for name, (low, high) in (limits or {}).items())
        control = _recipe.without_none(
            setpoint=pairs(setpoint),
            q=pairs(q),
            r=pairs(r),
            integral=pairs(integral),
            limits=None if limits is None else ranges,
            drive=None if drive is None else ",".join(names_of(drive)),
            free=None if free is None else ",".join(names_of(free)),
            period=None if period is None else period_seconds(period, "period"),
            schedule=schedule,
        )
        return Controller(self._core.control_lqr(_recipe.to_json({"control": control})))
