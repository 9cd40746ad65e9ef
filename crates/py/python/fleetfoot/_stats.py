"""Statistics as values: plans, scans, sums, parts and solutions."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any, Literal, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ._core import Data, Statistic
from ._data import open as open_data
from ._episodes import Episode, Episodes, matching
from ._progress import Progress, reporting
from ._recipe import as_toml
from ._solution import Solution, solution, strength
from ._values import count
from ._warnings import tell_all
from .exceptions import StatisticError

#: Forms of a recipe: a path, TOML text, or the same as a mapping.
Recipe: TypeAlias = "str | os.PathLike[str] | Mapping[str, Any]"


class Rows(NamedTuple):
    """Counts of the rows of a scan."""

    #: Rows that were summed.
    complete: int
    #: Rows that lack neighbours (lags, differences) at the border of their episode.
    at_border: int
    #: Rows with a missing value.
    incomplete: int


class Gram(NamedTuple):
    """The normal equations of one task, in raw units."""

    #: Names of the p columns.
    names: list[str]
    #: Name of the target.
    target: str
    #: X'X, shape (p, p).
    xtx: NDArray[np.float64]
    #: X'y, shape (p,).
    xty: NDArray[np.float64]
    #: y'y.
    yty: float
    #: Rows, weights included.
    weight: float


Value = TypeVar("Value", bound="_Value")


class _Value:
    """A statistic, with or without rows."""

    _core: Statistic

    @classmethod
    def _of(cls: type[Value], core: Statistic) -> Value:
        value = object.__new__(cls)
        value._core = core
        return value

    @classmethod
    def from_bytes(cls: type[Value], data: bytes) -> Value:
        """The value of ``to_bytes``.

        Raises
        ------
        StatisticError
            The bytes are damaged, of another kind, or of a newer version.
        """
        return cls._of(Statistic.from_bytes(bytes(data)))

    @classmethod
    def load(cls: type[Value], path: str | os.PathLike[str]) -> Value:
        """Reads a ``.stats`` file of this package or of ``fleetfoot scan``.

        Raises
        ------
        StatisticError
            The file is damaged, of another kind, or of a newer version.
        """
        return cls._of(Statistic.read(path))

    def to_bytes(self) -> bytes:
        """The bytes of a ``.stats`` file: equal for equal values, on any machine."""
        return self._core.to_bytes()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a ``.stats`` file atomically; an existing file is replaced.

        Raises
        ------
        WriteError
            The file cannot be written.
        """
        self._core.write(path)

    def __reduce__(self) -> tuple[Any, ...]:
        return (type(self).from_bytes, (self.to_bytes(),))

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return isinstance(other, _Value) and self.to_bytes() == other.to_bytes()

    def __hash__(self) -> int:
        return hash(self.to_bytes())

    @property
    def recipe(self) -> str:
        """The recipe as TOML, its wildcards written out."""
        return self._core.recipe

    @property
    def tasks(self) -> list[str]:
        """Names of the equations whose targets are summed."""
        return self._core.tasks

    @property
    def functions(self) -> dict[str, list[str]]:
        """Candidate functions by the name of their latent function."""
        return dict(self._core.latents)

    @property
    def serves(self) -> list[str]:
        """The methods that need no logs, each with its summed regions:
        ``"fit pwa (partition='average' | 'kmeans:5')"``."""
        return self._core.serves


def rows_of_chunk(chunk_rows: int | None) -> int | None:
    """A checked number of rows."""
    return None if chunk_rows is None else count("chunk_rows", chunk_rows, 1)


class Plan(_Value):
    """Definition of a scan: columns, functions, targets, and the coordinates of a pilot sample.

    Scans of one plan can be added. A plan is frozen: it is equal on every machine, and its hash identifies it.

    Parameters
    ----------
    recipe : path, str, mapping or None
        The recipe with fields and candidate functions; ``None``: that of the data set.
    data : Dataset, path, table, array or list
        Recordings for the pilot sample, as in :func:`fleetfoot.open`: all recordings of the scans, or typical ones.
    chunk_rows : int, optional
        Largest number of rows behind one stored sum; default: by the number of rows.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of the stage's name, the pieces done and the pieces in all.

    Raises
    ------
    RequestError
        The recipe cannot be understood, or names an unknown column.
    DataError
        The recordings cannot be read.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> t = np.arange(200) * 0.01
    >>> runs = [{"t": t, "x": np.sin(t + k), "y": 3 * np.sin(t + k) + 1} for k in (0.0, 0.5)]
    >>> recipe = {"model": {"predict": "y"}, "inputs": {"x": "x"}, "time": {"column": "t"}}
    >>> plan = ff.Plan(recipe, runs)
    >>> plan.functions
    {'f_y': ['1', 'x']}
    >>> ff.scan(plan, runs[0]).plan == plan
    True
    """

    def __init__(
        self,
        recipe: Recipe | None,
        data: Any,
        *,
        chunk_rows: int | None = None,
        progress: Progress = None,
    ) -> None:
        dataset = open_data(data, recipe=recipe)
        with reporting(progress) as callback:
            self._core, notes = Statistic.freeze(dataset.recipe, dataset._core, [], rows_of_chunk(chunk_rows), callback)
        tell_all(notes)

    @property
    def hash(self) -> str:
        """Hash of the plan, its coordinates included: scans with equal hashes can be added."""
        return self._core.hash

    @property
    def chunk_rows(self) -> int:
        """Largest number of rows behind one stored sum."""
        return self._core.chunk_rows

    def __str__(self) -> str:
        return self._core.text

    def __repr__(self) -> str:
        return f"Plan({', '.join(self.tasks)}; {sum(map(len, self.functions.values()))} functions; {self.hash[:12]})"


class Stats(_Value):
    """The sums of a scan, which replace the rows in any number of fits. Made by :func:`fleetfoot.scan`.

    A statistic is immutable; ``a + b`` is the statistic of the rows of both. Sums are kept by episode and chunk, so
    episodes can be dropped and the bits do not depend on the order of the summation.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> t = np.arange(200) * 0.01
    >>> runs = [{"t": t, "x": np.sin(t + k), "y": 3 * np.sin(t + k) + 1} for k in (0.0, 0.5)]
    >>> plan = ff.Plan({"model": {"predict": "y"}, "inputs": {"x": "x"}, "time": {"column": "t"}}, runs)
    >>> a, b = ff.scan(plan, runs[0]), ff.scan(plan, ff.open(runs[1], name="second"))
    >>> both = a + b
    >>> both
    Stats(2 episodes, 400 rows; y)
    >>> [episode.name for episode in both.drop("run").episodes]
    ['second']
    >>> solution = both.solve()
    >>> np.round(solution.coefficients, 9).tolist()
    [1.0, 3.0]
    """

    def __init__(self) -> None:
        raise TypeError("a statistic is made by fleetfoot.scan, Stats.load or Stats.from_bytes")

    @property
    def plan(self) -> Plan:
        """The plan of the sums."""
        return Plan._of(self._core.plan())

    @property
    def rows(self) -> Rows:
        """Summed rows, and left-out rows."""
        return Rows(*self._core.rows)

    @property
    def chunks(self) -> int:
        """Number of stored sums, each of consecutive rows of one episode."""
        return self._core.chunks

    @property
    def episodes(self) -> list[Episode]:
        """The episodes, in the order of their identities."""
        return [Episode(**record) for record in self._core.episodes()]

    @property
    def files(self) -> list[str]:
        """Paths of the scanned files and names of the scanned tables, as given."""
        return [name for name, _, _ in self._core.files]

    def __repr__(self) -> str:
        count = len(self._core.episodes())
        return f"Stats({count} episode{'' if count == 1 else 's'}, {self.rows.complete} rows; {', '.join(self.tasks)})"

    def __add__(self, other: Stats) -> Stats:
        if not isinstance(other, Stats):
            return NotImplemented
        return merge([self, other])

    def __radd__(self, other: Any) -> Stats:
        # sum([...]) begins with 0.
        return self if isinstance(other, int) and other == 0 else NotImplemented

    def select(self, episodes: Episodes | None = None, *, where: Mapping[str, Any] | None = None) -> Stats:
        """The statistic of some of the episodes, equal to that of a scan of them with this plan.

        Parameters
        ----------
        episodes : str, Episode, list of them, or callable, optional
            Names or identities (or at least eight digits of their beginning), records of :attr:`episodes`, or a
            function of a record.
        where : mapping, optional
            Labels and the value, or the values, that they must have.

        Raises
        ------
        StatisticError
            A name matches no episode, or no episode would be left.
        """
        return self._kept(matching(self.episodes, episodes, where))

    def drop(self, episodes: Episodes | None = None, *, where: Mapping[str, Any] | None = None) -> Stats:
        """The statistic without some of the episodes, selected as in :meth:`select`.

        Raises
        ------
        StatisticError
            A name matches no episode, or no episode would be left.
        """
        unwanted = matching(self.episodes, episodes, where)
        return self._kept({episode.id for episode in self.episodes} - unwanted)

    def compact(self) -> Stats:
        """One sum per episode: smaller, but without folds and resampling within an episode."""
        return Stats._of(self._core.compacted())

    def gram(self, task: str | int | None = None) -> Gram:
        """The normal equations of a task over all rows, raw and not centred, for external solvers.

        Squared columns lose half of the digits if they are nearly collinear; :meth:`solve` avoids this.

        Parameters
        ----------
        task : str or int, optional
            Name or number of the task; required if there are several.

        Raises
        ------
        StatisticError
            The task does not exist, or there are no rows.
        """
        root = self._core.root(self._task(task))
        r, z, mean, weight = root["r"], root["z"], root["mean_x"], root["weight"]
        mean_y = root["mean_y"]
        return Gram(
            names=root["names"],
            target=root["target"],
            xtx=r.T @ r + weight * np.outer(mean, mean),
            xty=r.T @ z + weight * mean_y * mean,
            yty=float(z @ z + root["residual"] + weight * mean_y * mean_y),
            weight=weight,
        )

    def solve(
        self,
        method: Literal["least-squares", "ridge", "lasso", "elastic-net"] = "least-squares",
        alpha: float | None = None,
        *,
        l1_ratio: float | None = None,
        recipe: Recipe | None = None,
        progress: Progress = None,
    ) -> Solution:
        """Coefficients at a given penalty, without a choice, held-out rows or a refit.

        The objective is
        ``1/(2n) sum_t rss_t / scale_t^2 + alpha (l1_ratio sum_j |b_j u_j| + (1 - l1_ratio)/2 sum_j (b_j u_j)^2)``: n
        rows; ``scale_t`` the recipe's scale of the task, else the deviation of its target; ``u_j`` the deviation of
        column j over the tasks in units of their scales (1 with ``unscaled`` in the recipe's ``[sparse]``). Constant
        terms of an equation are not penalised. The coefficients are in raw units.

        Parameters
        ----------
        method : {"least-squares", "ridge", "lasso", "elastic-net"}
            Ridge has ``l1_ratio = 0``, the lasso 1.
        alpha : float, optional
            The penalty, lambda of the engine; required except for least squares.
        l1_ratio : float, optional
            Share of the absolute values in the penalty; ``"elastic-net"`` needs it.
        recipe : path, str or mapping, optional
            Recipe with other penalty factors, signs, scales and prior strengths; functions and tasks must be those of
            the scan.
        progress : bool or callable, optional
            As in :func:`fleetfoot.scan`.

        Returns
        -------
        Solution
            Names, coefficients, standard errors (of least squares), certificate and model.

        Raises
        ------
        RequestError
            The recipe cannot be understood; ``alpha`` is negative.
        StatisticError
            The recipe names a function or task that was not summed.
        ValueError
            The method is unknown, or an option does not apply to it.
        """
        alpha, ratio = strength(method, alpha, l1_ratio)
        text = None if recipe is None else as_toml(recipe)
        with reporting(progress) as callback:
            return solution(method, self._core.solve(text, alpha, ratio, callback))

    def _as_data(self) -> Data:
        """The statistic as data, for fits without rows."""
        return self._core.data()

    def _task(self, task: str | int | None) -> int:
        names = self.tasks
        if task is None and len(names) == 1:
            return 0
        if isinstance(task, str) and task in names:
            return names.index(task)
        if isinstance(task, (int, np.integer)) and 0 <= task < len(names):
            return int(task)
        problem = "task is not given, and there are several" if task is None else f"there is no task {task!r}"
        raise StatisticError(f"{problem}: {', '.join(names)}")

    def _kept(self, identities: set[str]) -> Stats:
        if not identities:
            raise StatisticError(f"none of the {len(self._core.episodes())} episodes would be left; select others")
        return Stats._of(self._core.kept(identities))


def scan(
    plan: Plan | Recipe | None,
    data: Any,
    *,
    keys: str | Iterable[str] = (),
    chunk_rows: int | None = None,
    progress: Progress = None,
) -> Stats:
    """Reads recordings once and sums them by a plan.

    Parameters
    ----------
    plan : Plan, path, str, mapping or None
        A plan; or a recipe, whose plan is frozen from a pilot sample of these recordings; ``None``: the recipe of the
        data set.
    data : Dataset, path, table, array or list
        Recordings, as in :func:`fleetfoot.open`. A duplicate is summed once, with a warning.
    keys : str or list of str, optional
        Labels of episodes from the paths of their files: ``"aircraft={dir1}"`` is the folder's name, ``{dir2}`` the one
        above, ``{name}`` and ``{stem}`` the file's.
    chunk_rows : int, optional
        As in :class:`fleetfoot.Plan`; a plan has its own.
    progress : bool or callable, optional
        ``True`` for a bar of tqdm, or a function of the stage's name, the pieces done and the pieces in all.

    Returns
    -------
    Stats

    Raises
    ------
    RequestError
        The recipe cannot be understood or names an unknown column; no row is complete.
    DataError
        The recordings cannot be read.
    StatisticError
        The recordings do not match the plan.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> x = np.linspace(0.0, 1.0, 50)
    >>> recipe = {"model": {"predict": "y", "degree": 2}, "inputs": {"x": "x"}, "time": {"dt": 0.1}}
    >>> stats = ff.scan(recipe, {"x": x, "y": 2 * x**2})
    >>> round(stats.solve().as_dict()["f_y"]["x^2"], 9)
    2.0
    """
    labels = [keys] if isinstance(keys, str) else list(keys)
    if isinstance(plan, Plan):
        if chunk_rows is not None:
            raise ValueError("chunk_rows: the plan has its own; leave it out, or give it to Plan")
        dataset = open_data(data)
        with reporting(progress) as callback:
            core, skipped, notes = plan._core.scan_with(dataset._core, labels, False, callback)
    else:
        dataset = open_data(data, recipe=plan)
        with reporting(progress) as callback:
            core, skipped, notes = Statistic.scan(dataset.recipe, dataset._core, labels, rows_of_chunk(chunk_rows), callback)
    tell_all(notes + [f"left out: {name}" for name in skipped])
    return Stats._of(core)


def merge(statistics: Iterable[Stats]) -> Stats:
    """Merges statistics of one plan: a union by episode and chunk, equal in any order.

    Parameters
    ----------
    statistics : iterable of Stats
        At least one. ``sum(statistics)`` and ``a + b`` are equivalent.

    Raises
    ------
    StatisticError
        The plans differ, or two statistics hold the same log, which would count twice.

    Examples
    --------
    >>> import numpy as np, fleetfoot as ff
    >>> runs = [{"x": np.arange(9.0) * k, "y": np.arange(9.0) * k + k} for k in (1, 2, 3)]
    >>> plan = ff.Plan({"model": {"predict": "y"}, "inputs": {"x": "x"}, "time": {"dt": 1}}, runs)
    >>> parts = [ff.scan(plan, ff.open(run, name=f"run {k}")) for k, run in enumerate(runs)]
    >>> ff.merge(parts) == sum(parts) == ff.scan(plan, runs)
    True
    """
    parts = list(statistics)
    if not parts:
        raise ValueError("statistics is empty; give one at least")
    for at, part in enumerate(parts):
        if not isinstance(part, Stats):
            raise TypeError(f"statistics[{at}] is a {type(part).__name__}; give values of fleetfoot.Stats")
    return Stats._of(parts[0]._core.merged([part._core for part in parts[1:]]))
