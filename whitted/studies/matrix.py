"""All cells of a study: its scenes and methods as a worker finds them, and the order in which they run."""

from dataclasses import dataclass

from whitted.errors import UsageError
from whitted.specification import as_dict
from whitted.studies import rendering
from whitted.studies.cells import cells_of, interleaved
from whitted.studies.pools import WorkerLostError
from whitted.studies.specification import IntegratorEntry


@dataclass(frozen=True)
class Matrix:
    """The cells of a study.

    Attributes:
        references: from a scene's label to the cells of its reference, a list.
        cells: the others, in the order in which they run.
        listed: all cells, as the study lists them.
        own: pairs of a scene and a method of one of our integrators.
        versions: that are part of all keys, a dict.
    """

    references: dict
    cells: list
    listed: list
    own: list
    versions: dict

    @property
    def ordered(self):
        """All cells in the order in which they run."""
        return [*(cell for cells in self.references.values() for cell in cells), *self.cells]


def matrix_of(specification, pool):
    """Return the `Matrix` of a study.

    Args:
        specification: `whitted.studies.specification.Specification`.
        pool: see `whitted.studies.pools`; its first worker loads the scenes and decides what methods leave open.

    Raises:
        UsageError: a scene can't be loaded, there is no such integrator, sampler or effect, or two scenes or two
            methods of a scene are the same but for what they are called.
    """
    spec, choices = specification, _choices(specification)
    references, turns, own = {}, [], []
    for entry in spec.scenes:
        scene, methods, versions = _described(pool, spec, entry, choices)
        *groups, (reference,) = methods
        flat = [method for group in groups for method in group]
        references[scene.label], ladders = cells_of(spec, scene, flat, reference, versions)
        turns.append(ladders)
        own += [(scene, method) for method in flat if method.sampler is None]
    cells = interleaved(turns, spec.seed)
    _check_distinct(cells)
    listed = [cell for cells in references.values() for cell in cells]
    listed += [cell for ladders in turns for ladder in ladders for cell in ladder]
    return Matrix(references, cells, listed, own, versions)


def _choices(spec):
    """What `whitted.studies.rendering.describe` is to describe: the integrators, and last that of the reference."""
    shared = {"samplers": spec.samplers, "effects": spec.effects, "spp": spec.spp}
    choices = [{"integrator": entry.integrator, "label": entry.label} | shared for entry in spec.integrators]
    wanted = spec.reference
    # A reference leaves nothing out, however little it matters
    effects = "auto" if "effects" in as_dict(wanted.integrator) else "all"
    own = {"samplers": (wanted.sampler,), "effects": (effects,), "spp": (wanted.spp,)}
    label = IntegratorEntry(integrator=wanted.integrator).label
    return [*choices, {"integrator": wanted.integrator, "label": label} | own]


def _described(pool, spec, entry, choices):
    """A scene, its methods by choice, and the versions that are part of a key."""
    first, size = pool.workers[0], (spec.width, spec.height)
    try:
        return pool.submit(
            first, rendering.describe, first.cores, spec.variant, entry, size, choices
        ).result()
    except WorkerLostError as error:
        raise UsageError(f"scene '{entry.label}': the process that loaded it ended") from error


def _check_distinct(cells):
    """Refuse a study in which two scenes, or two methods of a scene, are the same but for what they are called."""
    called = {}
    for cell in cells:
        name = f"{cell.scene.label}: {cell.method.label}"
        if called.setdefault(cell.key, name) != name:
            raise UsageError(f"'{called[cell.key]}' and '{name}' are the same")
