"""Episodes behind a statistic, and their names."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from .exceptions import StatisticError

#: Forms that name episodes: a name, an identity, a record, several of them, or a function of the record.
Episodes: TypeAlias = "str | Episode | Iterable[str | Episode] | Callable[[Episode], bool]"

#: Digits of an identity that name an episode, at least.
_LEAST_DIGITS = 8


@dataclass(frozen=True)
class Episode:
    """One uninterrupted recording behind a statistic.

    Attributes
    ----------
    id : str
        Identity, by its content.
    name : str
        Name of its file (the path if two files share the name), with ``#k`` if the file holds several episodes.
    file : str
        File or table of the episode.
    labels : dict of str
        Labels from the recipe and from the path.
    rows : int
        Rows in all.
    complete : int
        Summed rows.
    start, end : int
        First and last stamp, nanoseconds.
    period : float
        Median sampling period, seconds; 0 for a single row.
    """

    id: str
    name: str
    file: str
    rows: int
    complete: int
    start: int
    end: int
    period: float
    labels: dict[str, str] = field(default_factory=dict, hash=False)


def matching(known: list[Episode], episodes: Episodes | None, where: Mapping[str, Any] | None) -> set[str]:
    """Identities of the episodes that ``episodes`` and ``where`` select."""
    if episodes is None and where is None:
        raise ValueError("neither episodes nor where is given; name the episodes")
    chosen = {episode.id for episode in known} if episodes is None else _named(known, episodes)
    for label, value in (where or {}).items():
        values = {value} if isinstance(value, str) or not isinstance(value, Iterable) else set(value)
        chosen &= _labelled(known, label, {str(one) for one in values})
    return chosen


def _named(known: list[Episode], episodes: Episodes) -> set[str]:
    if callable(episodes):
        return {episode.id for episode in known if episodes(episode)}
    asked = [episodes] if isinstance(episodes, (str, Episode)) else list(episodes)
    chosen: set[str] = set()
    for one in asked:
        if not isinstance(one, (str, Episode)):
            raise TypeError(f"episodes has a {type(one).__name__}; give names, identities or records")
        text = one.id if isinstance(one, Episode) else one
        digits = text.lower() if len(text) >= _LEAST_DIGITS else None
        these = {e.id for e in known if e.name == text or (digits is not None and e.id.startswith(digits))}
        if not these:
            raise StatisticError(f"{text!r} matches no episode; {_nearest(text, [e.name for e in known])}")
        chosen |= these
    return chosen


def _labelled(episodes: list[Episode], label: str, values: set[str]) -> set[str]:
    known = {episode.labels[label] for episode in episodes if label in episode.labels}
    for value in sorted(values - known):
        names = sorted(known) if known else sorted({name for episode in episodes for name in episode.labels})
        what = "values" if known else "labels"
        missing = "no episode has labels; scan with keys=['name={dir1}']"
        there = _nearest(value if known else label, names) if names else missing
        raise StatisticError(f"where: {label} = {value!r} matches no episode; of {what} {there}")
    return {episode.id for episode in episodes if episode.labels.get(label) in values}


def _nearest(text: str, names: list[str]) -> str:
    shown = difflib.get_close_matches(text, names, 3) or names[:8]
    return f"there is {', '.join(shown)}" + (f" and {len(names) - len(shown)} more" if len(names) > len(shown) else "")
