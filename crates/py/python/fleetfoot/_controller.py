"""Controllers made from models."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from . import _core
from ._warnings import tell_all
from .exceptions import DataError

if TYPE_CHECKING:
    Array = np.ndarray[Any, np.dtype[np.float64]]


class Controller:
    """Control law that keeps a model, or its robot, at a set point: the result of :meth:`Model.lqr` or
    :meth:`Model.mpc`.

    :meth:`Model.rollout` uses it to close the loop around a model, :func:`fleetfoot.generate` around a simulated
    robot. The command line reads its file.

    Attributes
    ----------
    states, inputs : tuple of str
        States that are fed back (a rotation as ``"attitude about x"``, ``y`` and ``z``), and driven inputs.
    setpoint : dict
        ``states`` and ``inputs`` by name, ``region`` (that rests there, or None), ``drift`` and ``at_rest``.
    regions : list of dict
        For every law ``region``, ``rows``, ``unreached`` (unreachable modes, in words), ``radius`` (spectral radius
        of the closed loop per sample), ``residual`` (of the Riccati equation, relative), ``rests``, ``borrowed``.
    notes : list of str
        Notes for the user.
    """

    __slots__ = ("_text", "inputs", "law", "notes", "regions", "setpoint", "states")

    def __init__(self, text: str) -> None:
        content = json.loads(text)["controller"]
        self._text = text
        self.law: dict[str, Any] = content["law"]
        self.setpoint: dict[str, Any] = content["setpoint"]
        self.regions: list[dict[str, Any]] = content["regions"]
        self.notes: list[str] = tell_all(content["notes"])
        turns = (f"{one['name']} about {axis}" for one in self.law.get("rotations", ()) for axis in "xyz")
        self.states = (*(state["name"] for state in self.law["states"]), *turns)
        self.inputs = tuple(driven["name"] for driven in self.law["inputs"])

    @property
    def gains(self) -> Array:
        """K by region, (regions, inputs, states): ``u = u_i - K_i (x - x*) - ...``.

        Those of a predictive controller hold while no limit and no bound is active.
        """
        return np.array([law["gain"] for law in self.law["laws"]], dtype=float)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Controller:
        """Reads the file of a controller, from :meth:`save` or ``fleetfoot control lqr``.

        Raises
        ------
        DataError
            The file cannot be read.
        ModelError
            It holds no controller.
        """
        try:
            with open(path, encoding="utf-8") as file:
                text = file.read()
        except (OSError, UnicodeDecodeError) as error:
            raise DataError(f"{os.fspath(path)} cannot be read as a controller: {error}") from error
        return cls(_core.check_controller(text, os.fspath(path)))

    def to_json(self) -> str:
        """The controller's file as text."""
        return self._text

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the controller's file, whole or not at all, for ``--controller`` of the command line."""
        _core.write_controller(self._text, path)

    def export(
        self,
        to: Literal["c", "rust", "python", "latex", "npz"],
        folder: str | os.PathLike[str] = ".",
        *,
        prefix: str = "controller",
        precision: Literal["double", "float"] = "double",
    ) -> list[str]:
        """Writes the law in another language, as :meth:`Model.export` writes a model.

        In the code, ``x`` are the driven inputs and the integrals, ``u`` the measurements. A step is one sample,
        after which the first of ``x`` are the commands. A missing measurement leaves them unchanged. A predictive
        controller is written as C only, with its commands in ``command``.

        Parameters
        ----------
        to : {"c", "rust", "python", "latex", "npz"}
            The language.
        folder : path
            Folder of the files, created if necessary.
        prefix : str
            Prefix of all names, and name of the files.
        precision : {"double", "float"}
            Floating-point type of C and Rust.

        Returns
        -------
        list of str
            The files.

        Raises
        ------
        ModelError, OptionError, WriteError
        """
        files = _core.export_controller(self._text, to, os.fspath(folder), prefix, precision)
        return [os.fspath(file) for file in files]

    def __repr__(self) -> str:
        count = len(self.regions)
        laws = f"{count} law{'' if count == 1 else 's'}"
        return f"Controller({', '.join(self.inputs)} by {', '.join(self.states)}; {laws})"

    def __reduce__(self) -> tuple[Any, ...]:
        return Controller, (self._text,)


def what(controller: Controller | str | os.PathLike[str] | None) -> str | None:
    """A controller for the engine: the text of its file, or a kind or path unchanged."""
    if isinstance(controller, Controller):
        return controller.to_json()
    return None if controller is None else os.fspath(controller)
