"""The cells that are to be rendered, in the order in which they are given out."""

from collections import deque
from dataclasses import dataclass, field

from whitted.studies.cells import REFERENCE


@dataclass(eq=False)
class Task:
    """A cell with what is left to do of it and what is done.

    Attributes:
        cell: `whitted.studies.cells.Cell`.
        parts: those that nobody is at.
        attempt: its number in the store.
        lost: how often a worker died of it.
        results: by part, what workers have given.
        environments: the ids of their machines.
        running: how many parts are being rendered.
        failed: it is given up.
        owner: the name of the worker that does all of a timed cell.
    """

    cell: object
    parts: list
    attempt: int | None = None
    lost: int = 0
    results: dict = field(default_factory=dict)
    environments: set = field(default_factory=set)
    running: int = 0
    failed: bool = False
    owner: str | None = None

    @classmethod
    def of(cls, cell):
        """Return the task of a cell, from its beginning."""
        return cls(cell, list(cell.parts))


class Queue:
    """Tasks: references first, then those that need a machine to themselves, then the others.

    Args:
        tasks: list of `Task`.
    """

    def __init__(self, tasks):
        self._references = deque(task for task in tasks if task.cell.role == REFERENCE)
        self._timed = deque(task for task in tasks if task.cell.timed)
        self._others = deque(task for task in tasks if not task.cell.timed and task.cell.role != REFERENCE)
        self.begun = []

    def __bool__(self):
        return bool(self.begun or self._references or self._timed or self._others)

    def take(self, name, may_time, alone):
        """Return a task of which a worker shall do the next part, or None.

        Args:
            name: the worker's.
            may_time: seconds of its machine count.
            alone: nobody else is at work on its machine.
        """
        for task in self.begun:
            if task.parts and (task.owner == name if task.cell.timed else True):
                return task
        if self._references:
            return self._begin(self._references)
        if self._timed and may_time:  # where others are at work, they are waited for
            return self._begin(self._timed, name) if alone else None
        return self._begin(self._others) if self._others else None

    def put_back(self, task, part):
        """Take back a part that was lost; a timed cell begins anew, on any machine."""
        task.owner = None
        if not task.cell.timed:
            task.parts.insert(0, part)
            return
        self.drop(task)
        task.parts = list(task.cell.parts)
        self._timed.appendleft(task)

    def drop(self, task):
        """Forget a task, which is done or given up."""
        self.begun.remove(task)
        task.results.clear()

    def _begin(self, tasks, owner=None):
        task = tasks.popleft()
        task.owner = owner
        self.begun.append(task)
        return task
