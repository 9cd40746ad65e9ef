"""Models: read, stepped, linearised, scored, exported."""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from . import _core, plot
from ._arrays import floats, period_seconds, since_first
from ._equations import Content
from ._filtering import Filtering
from ._frames import in_order
from ._html import of_model
from ._on_recordings import OnRecordings
from ._regulated import Regulated
from ._values import count
from ._warnings import warn
from .exceptions import ModelError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    Array = np.ndarray[Any, np.dtype[np.float64]]
    History = tuple[ArrayLike, ArrayLike]


class Model(OnRecordings, Filtering, Regulated):
    """An immutable model of a recording: targets, regressors and equations.

    Models come from fits and from :func:`fleetfoot.load`. At points, ``x`` holds :attr:`states` and ``u`` holds
    :attr:`inputs`, in their orders and in the units of the columns (SI, radians): of shape (states,) for one point or
    (points, states) for many, and so for ``u``. A model with lags needs past rows, ``history=(x_past, u_past)``: the
    :attr:`lags` rows before the point, the oldest first, of shape (lags, states) and (lags, inputs) for all points,
    or (points, lags, states) and (points, lags, inputs).

    Attributes
    ----------
    states : tuple of str
        States of the equations; then first-order lags (``lag1``) of computed columns, which are states too. By
        default start each lag at the value of its signal.
    inputs : tuple of str
        Columns from outside, and all other columns that the equations read. Columns that follow from states, inputs
        and time are computed and not listed.
    outputs : tuple of str
        Left sides of the fitted equations: ``d(x)/dt``, ``next(y)``, ``force``.
    regions : tuple of str
        Names of the regions.
    lags : int
        Past rows that the equations use.
    dt : float
        The sampling period of the training data, seconds: the step of a discrete model.
    is_continuous : bool
        True if a derivative is integrated.
    method : str
        Method of the fit.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> t = np.arange(0, 5, 0.01)
    >>> x = np.column_stack([np.cos(2 * t), -2 * np.sin(2 * t)])
    >>> model = ff.PWA().fit(x, t, feature_names=["q", "v"]).model_
    >>> model.states, model.outputs
    (('q', 'v'), ('d(q)/dt', 'd(v)/dt'))
    >>> np.round(model.derivative([1.0, 0.0]), 2) + 0.0
    array([ 0., -4.])
    """

    __slots__ = ("_content", "_core", "dt", "inputs", "is_continuous", "lags", "outputs", "states", "uses_time")

    def __init__(self, core: _core.Model) -> None:
        states, inputs, outputs = core.names()
        self._core = core
        self._content: Content | None = None
        self.states, self.inputs, self.outputs = tuple(states), tuple(inputs), tuple(outputs)
        self.lags, self.uses_time, self.is_continuous, self.dt = core.facts()

    # -- what it is

    @property
    def content(self) -> Content:
        """Content of the model's file."""
        if self._content is None:
            self._content = Content(self._core.to_json())
        return self._content

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions of the first latent's partition."""
        return tuple(self.content.regions())

    @property
    def method(self) -> str:
        """Method of the fit."""
        return self.content.method

    @property
    def recipe(self) -> str:
        """The recipe of the fit, TOML."""
        return str(self.content.training["recipe"])

    def equations(self, precision: int = 5, *, region: int | None = None) -> list[str]:
        """The equations with numbers for coefficients.

        Parameters
        ----------
        precision : int
            Significant digits.
        region : int, optional
            Region to print; default: all.

        Returns
        -------
        list of str
            ``d(x)/dt = -10*x + 10*y``; with several regions one for each, ``region 3: d(x)/dt = ...``.
        """
        return self.content.equations(precision, region)

    def coefficients(self, *, latent: str | None = None, region: int | None = None) -> Array:
        """Coefficients of the fitted functions, the constant first, in the order of :meth:`get_feature_names`.

        Parameters
        ----------
        latent : str, optional
            One latent function, if they have different libraries.
        region : int, optional
            One region.

        Returns
        -------
        array
            (outputs, functions) for a single or selected region, else (regions, outputs, functions); with ``latent``
            without the middle axis.

        Raises
        ------
        ModelError
            The latent functions have different libraries and none is selected; an unknown name or region.
        """
        matrix = self.content.coefficients(latent)
        if latent is not None:
            matrix = matrix[:, 0]
        if region is not None and not 0 <= region < len(matrix):
            raise ModelError(f"region={region}: the model has the regions 0 to {len(matrix) - 1}")
        if region is None and len(matrix) > 1:
            return matrix
        return np.asarray(matrix[region or 0])

    def get_feature_names(self, latent: str | None = None) -> list[str]:
        """Names of the candidate functions, the constant ``"1"`` first."""
        return self.content.feature_names(latent)

    @property
    def complexity(self) -> int:
        """Number of terms: non-zero coefficients of all equations and regions."""
        return self.content.complexity()

    def plot(self, data: Any = None, **options: Any) -> Any:
        """The coefficients of an equation, or with data the measured values beside the predictions, by matplotlib:
        :func:`fleetfoot.plot.coefficients` and :func:`fleetfoot.plot.prediction`.
        """
        return plot.coefficients(self, **options) if data is None else plot.prediction(self, data, **options)

    def describe(self, regions: int = 10) -> str:
        """The model as text: columns, equations, and its ``regions`` largest regions."""
        return self._core.describe(count("regions", regions, 0))

    def print(self, regions: int = 10) -> None:
        """Prints :meth:`describe`."""
        print(self.describe(regions))

    def __str__(self) -> str:
        return self.describe()

    def __repr__(self) -> str:
        count = len(self.regions)
        return f"Model({self.method!r}, {', '.join(self.outputs)}; {count} region{'' if count == 1 else 's'})"

    def _repr_html_(self) -> str:
        return of_model(
            self.method, self.equations(), self._core.mathml(), len(self.regions), dt=self.dt, is_continuous=self.is_continuous
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Model) and self._core.hash() == other._core.hash()

    def __hash__(self) -> int:
        return hash(self._core.hash())

    def __copy__(self) -> Model:
        return self

    def __deepcopy__(self, memo: object) -> Model:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return Model, (self._core,)

    # -- files

    def to_json(self) -> str:
        """The model's file as text; reads back bit for bit."""
        return self._core.to_json()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the model's file (JSON), whole or not at all; :func:`fleetfoot.load` and the command line read it."""
        self._core.write(path)

    def export(
        self,
        to: Literal["c", "rust", "python", "latex", "npz", "onnx"],
        folder: str | os.PathLike[str] = ".",
        *,
        prefix: str = "model",
        precision: Literal["double", "float"] = "double",
        method: Literal["rk4", "euler"] = "rk4",
        dt: float | None = None,
        domain: bool = True,
    ) -> list[str]:
        """Writes the model in another language. Code is compared with the engine before it is written.

        Parameters
        ----------
        to : {"c", "rust", "python", "latex", "npz", "onnx"}
            The language; ``"onnx"`` of a model that is one network, or affine.
        folder : path
            Folder of the files, created if necessary.
        prefix : str
            Prefix of all names, and name of the files.
        precision : {"double", "float"}
            Floating-point type of C, Rust and ONNX.
        method : {"rk4", "euler"}
            Integration of derivatives.
        dt : float, optional
            Fixed step, seconds; default: the caller's step.
        domain : bool
            Write a check of the training range.

        Returns
        -------
        list of str
            The files.

        Raises
        ------
        ModelError
            The model cannot be written in this language.
        WriteError
            A file cannot be written.

        Notes
        -----
        The code has only the inputs that its equations read; :attr:`inputs` has all.
        """
        files, _, _ = self._core.export(to, folder, prefix, precision, method, self._period(dt), domain)
        return [os.fspath(file) for file in files]

    # -- at points

    def step(
        self,
        x: ArrayLike,
        u: ArrayLike | None = None,
        dt: float | None = None,
        *,
        method: Literal["rk4", "euler"] = "rk4",
        history: History | None = None,
        t: ArrayLike | None = None,
    ) -> Array:
        """The states one step later, with inputs held over the step.

        Parameters
        ----------
        x, u : array
            States and inputs: (states,) and (inputs,), or (points, states) and (points, inputs).
        dt : float, optional
            Step in seconds, for models of derivatives; default: the sampling period. Discrete models advance by one
            sample.
        method : {"rk4", "euler"}
            Integration of derivatives.
        history : pair of arrays, optional
            Past rows, for models with lags.
        t : float or array, optional
            Seconds since the start, for models that depend on time.

        Returns
        -------
        array
            As ``x``; angles within (-pi, pi]; NaN without a region.

        Raises
        ------
        ModelError
            An argument is missing or has a wrong shape.
        """
        x, u, history = self._by_name(x, u, history)
        return self._core.step(x, u, self._period(dt), method, history, t)

    def derivative(
        self,
        x: ArrayLike,
        u: ArrayLike | None = None,
        *,
        history: History | None = None,
        t: ArrayLike | None = None,
    ) -> Array:
        """The right sides of the states' equations: derivatives per second, next values, or differences.

        Parameters and errors as for :meth:`step`; the result has the shape of ``x``.
        """
        x, u, history = self._by_name(x, u, history)
        return self._core.right_sides(x, u, history, t)

    def linearize(
        self,
        x: ArrayLike,
        u: ArrayLike | None = None,
        dt: float | None = None,
        *,
        method: Literal["rk4", "euler"] = "rk4",
        history: History | None = None,
        t: ArrayLike | None = None,
    ) -> tuple[Array, Array, Array]:
        """The model to first order at a point, ``A x + B u + c``, by exact derivatives within the region there.

        Without ``dt`` it is that of the derivatives of a continuous model, or of the next states of a discrete one
        (angles not wrapped). With ``dt`` it is that of a step of so many seconds. ``c`` contains the contribution of
        past rows.

        Returns
        -------
        A, B, c : array
            (states, states), (states, inputs) and (states,); with a leading axis for several points.

        Raises
        ------
        ModelError
            An argument is missing or has a wrong shape.
        """
        x, u, history = self._by_name(x, u, history)
        return self._core.linearize(x, u, self._period(dt), method, history, t)

    def region(
        self,
        x: ArrayLike,
        u: ArrayLike | None = None,
        *,
        history: History | None = None,
        t: ArrayLike | None = None,
    ) -> Any:
        """The region of a point (int) or of points (array of int), an index of :attr:`regions`; -1 for a label that
        training did not see.

        ``u`` may be omitted if the region does not depend on inputs.
        """
        if u is None and self.inputs:
            u = np.zeros(len(self.inputs)) if self._regions_need_no_input() else None
        x, u, history = self._by_name(x, u, history)
        indices, single = self._core.regions(x, u, history, t)
        return int(indices[0]) if single else indices

    def _by_name(self, x: Any, u: Any, history: Any) -> tuple[Any, Any, Any]:
        """States, inputs and past rows of tables in the order of the model."""
        if history is not None:
            history = (in_order(history[0], self.states, "history: x"), in_order(history[1], self.inputs, "history: u"))
        return in_order(x, self.states, "x"), in_order(u, self.inputs, "u"), history

    def _period(self, dt: Any) -> float | None:
        return None if dt is None else period_seconds(dt, "dt")

    def _regions_need_no_input(self) -> bool:
        if not self.content.latents:
            return True
        columns = self.content.partitions[self.content.latents[0]["partition"]]["columns"]
        words = {word for column in columns for word in re.findall(r"`[^`]*`|\w+", column)}
        return not any(name in words or f"`{name}`" in words for name in self.inputs)

    def simulate(
        self,
        x0: ArrayLike,
        t: ArrayLike | int,
        u: ArrayLike | Callable[..., ArrayLike] | None = None,
        *,
        interpolate: bool = False,
        method: Literal["rk45", "rk4", "euler"] | None = None,
        substeps: int | None = None,
        rtol: float | None = None,
        atol: ArrayLike | None = None,
        history: History | None = None,
    ) -> Array:
        """The states over time.

        Models of derivatives are integrated with error control; the first step is the sampling period of the training
        data. Discrete models and models with lags advance row by row: their times are one sampling period apart.

        Parameters
        ----------
        x0 : array
            Initial state: (states,), or (points, states) for several.
        t : array of shape (times,), or int
            Ascending seconds; the first is that of ``x0``. Models that advance row by row also take a number of rows,
            including ``x0``.
        u : array or callable, optional
            Rows of inputs, (times, inputs) or (times - 1, inputs), with a leading axis for several points; each is
            held until the next time (or see ``interpolate``). Columns of tables are selected by name. Or a function
            of time, ``u(t)``, interpolated linearly; or a controller ``u(t, x)``, whose values are held. Functions
            are called at every time and at least once per sampling period of the model (with ``substeps`` at the
            times only).
        interpolate : bool, default=False
            Interpolate rows of ``u`` linearly instead of holding them; needs one row for each time.
        method : {"rk45", "rk4", "euler"}, optional
            Integration of derivatives: ``"rk45"`` is the pair 5(4) of Dormand and Prince with error control, and the
            implicit RODAS 4(3) for stiff equations; the others have equal steps. Default: ``"rk45"``, with
            ``substeps`` ``"rk4"``.
        substeps : int, optional
            Number of equal steps between times; default: steps no longer than the sampling period.
        rtol : float, optional
            Allowed error of a step relative to a state, for ``"rk45"``; default: 1e-8.
        atol : float or array of shape (states,), optional
            Additional absolute error in the units of the states; default: ``rtol`` times the standard deviation in
            training.
        history : pair of arrays, optional
            Rows before the first one, for models with lags.

        Returns
        -------
        array
            (times, states), or (points, times, states). NaN after a state is not finite, with a warning.

        Raises
        ------
        ModelError
            An argument is missing or has a wrong shape; no equation advances a state; times of a row-by-row model are
            not one period apart; the method lacks an option; ``interpolate`` in a closed loop.

        Examples
        --------
        >>> import numpy as np, fleetfoot as ff
        >>> t = np.arange(0, 5, 0.01)
        >>> decay = ff.PWA().fit(np.exp(-t), t).model_
        >>> decay.simulate([1.0], [0.0, 0.5, 1.0]).round(3).ravel()
        array([1.   , 0.607, 0.368])
        """
        how = self._passing(method, substeps, rtol, atol)
        x0, u, history = self._by_name(x0, u, history)
        grid = _core.time_grid(self._core, self._times(t))
        if callable(u):
            fine, places = grid.refined() if substeps is None else (grid, np.arange(len(grid) + 1))
            if _takes_state(u):
                self._refuse_open(interpolate)
                simulated, missed = self._closed_loop(floats(x0, "x0"), fine, u, how, history)
            else:
                sequence = np.array([np.atleast_1d(floats(u(time), "u")) for time in fine.times])
                simulated, missed = _core.simulate(self._core, x0, fine, sequence, how, history, True)
            simulated = simulated[..., places, :]
        else:
            simulated, missed = _core.simulate(self._core, x0, grid, u, how, history, bool(interpolate))
        bad = ~np.isfinite(simulated)
        # Divergence is reported below.
        if missed > _MISSED and not bad.any():
            warn(
                f"the shortest steps of the integration leave an error of {missed:.1g} times the size of a state: "
                "the right sides jump, or are stiff; compare with method='rk4' and substeps=, or fit a discrete model"
            )
        if bad.any():
            simulated[np.maximum.accumulate(bad.any(axis=-1), axis=-1)] = np.nan
            warn("the simulation is no finite number from some time on: it diverges, or no region holds")
        return simulated

    def _refuse_open(self, interpolate: bool) -> None:
        """Refuses options that a closed loop does not support."""
        if interpolate:
            raise ModelError(
                "interpolate=True with u(t, x): a closed loop holds its inputs; leave interpolate out, or give u(t)"
            )
        if self._core.ahead():
            raise ModelError(
                "u(t, x): the model reads the inputs of the next row, which a closed loop does not have yet; give u(t), or rows"
            )

    def _times(self, t: ArrayLike | int) -> ArrayLike:
        """The times of a simulation, or of a number of rows."""
        if isinstance(t, (bool, np.bool_)) or not isinstance(t, (int, np.integer)):
            return since_first(t, "t")
        if self.is_continuous and not self.lags:
            raise ModelError(f"t={t}: derivatives are integrated over seconds; give the times, np.arange({t}) * dt")
        if t < 1:
            raise ModelError(f"t={t}: give 1 row or more")
        return self.dt * np.arange(int(t))

    def _closed_loop(
        self,
        x0: Array,
        grid: _core.TimeGrid,
        u: Callable[..., ArrayLike],
        how: dict[str, Any],
        history: History | None,
    ) -> tuple[Array, float]:
        """Step by step, the inputs from a function of time and states."""
        states, missed = [x0], 0.0
        past = None if history is None else [floats(rows, "history") for rows in history]
        for at, now in enumerate(grid.times[:-1]):
            given = np.broadcast_to(floats(u(now, states[-1]), "u"), (*x0.shape[:-1], len(self.inputs)))
            before = None if past is None else (past[0], past[1])
            step, more = _core.simulate(self._core, states[-1], grid.interval(at), given[..., None, :], how, before)
            missed += more
            if past is not None:
                for which, row in enumerate((states[-1], given)):
                    wide = np.broadcast_to(past[which], (*x0.shape[:-1], *past[which].shape[-2:]))
                    past[which] = np.concatenate([wide, row[..., None, :]], axis=-2)[..., 1:, :]
            states.append(step[..., 1, :])
        return np.stack(states, axis=-2), missed

    def _passing(
        self, method: str | None, substeps: int | None, rtol: float | None, atol: ArrayLike | None
    ) -> dict[str, Any]:
        """Steps of a simulation from one time to the next."""
        if substeps is not None and (not isinstance(substeps, (int, np.integer)) or substeps < 1):
            raise ModelError(f"substeps={substeps!r}: give a whole number of 1 or more")
        allowed = None if atol is None else np.asarray(atol, dtype=float)
        if allowed is not None and allowed.shape not in ((), (len(self.states),)):
            raise ModelError(f"atol has the shape {allowed.shape}; give a number, or one for each of {self.states}")
        return {
            "method": method or ("rk45" if substeps is None else "rk4"),
            "substeps": None if substeps is None else int(substeps),
            "rtol": None if rtol is None else float(rtol),
            "atol": None if allowed is None else np.broadcast_to(allowed, (len(self.states),)).tolist(),
        }


#: Share of a state's size that the integration may miss without a word.
_MISSED = 1e-3


def _takes_state(u: Callable[..., Any]) -> bool:
    """True for a function of inputs that takes the states beside the time."""
    try:
        parameters = inspect.signature(u).parameters.values()
    except (TypeError, ValueError):
        return False
    positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return sum(one.kind in positional and one.default is inspect.Parameter.empty for one in parameters) >= 2
