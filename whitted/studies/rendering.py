"""What a worker does: it describes scenes and methods, and renders parts of cells, with the seconds told apart.

Scenes and integrators stay loaded from call to call, and kernels stay compiled. Left out: writing anything.
"""

import functools
import time as clock

import drjit as dr
import mitsuba as mi

from whitted import _backend
from whitted.effects import chosen
from whitted.errors import UsageError, nearest
from whitted.film import Window, colours, resize
from whitted.image import encode_exr
from whitted.messages import plugin_names
from whitted.noise import noise_shares
from whitted.replicates import box_sensor
from whitted.results import versions
from whitted.sampler_passes import SamplerPasses
from whitted.sampling.groups import Replicates
from whitted.scene import load
from whitted.specification import as_dict
from whitted.specification import integrator as make_integrator
from whitted.studies.cells import Method, Scene
from whitted.studies.finishing import finished
from whitted.tracing import TreePasses, samples_per_pass

KEYED = ("whitted", "mitsuba", "drjit")  # versions that are part of a cell's key
SCENES = 8  # kept loaded

_references = {}  # by id, those that this process was given: one for each scene of a study


def describe(variant, entry, size, choices):
    """Load a scene, and decide all that its methods leave open.

    Args:
        variant: of Mitsuba.
        entry: `whitted.studies.specification.SceneEntry`.
        size: width and height in pixels for a scene that names none; None: its own.
        choices: list of dicts: ``integrator`` (text or dict), ``label``, ``samplers``, ``effects`` and ``spp``, lists.

    Returns:
        `Scene`; for each choice a list of `Method`; and the versions that are part of a key, a dict.

    Raises:
        UsageError: the scene can't be loaded, or there is no such integrator, sampler or effect.
    """
    _backend.activate(variant)
    wanted = (entry.width or size[0], entry.height or size[1])
    loaded, camera = _load(entry.scene, tuple(sorted(entry.define.items())), entry.sensor, *wanted)
    width, height = (int(n) for n in camera.film().size())
    scene = Scene(entry.label, str(entry.scene), entry.define, entry.sensor, width, height, loaded.hash)
    methods = [_methods(loaded, camera, **choice) for choice in choices]
    return scene, methods, {name: versions()[name] for name in KEYED}


def render_whole(cell, identity, reference, names):
    """Render a cell of one part, and finish it.

    Args:
        cell: `whitted.studies.cells.Cell`.
        identity, reference: id and `whitted.studies.finishing.Reference` of its scene, which is kept; the latter is
            None where this process has it, the former too where there is none.
        names: of metrics.

    Returns:
        `whitted.studies.finishing.Finished`.
    """
    if reference is not None:
        _references[identity] = reference
    return finished(cell, {cell.whole: render(cell, cell.whole)}, _references.get(identity), names)


def render(cell, part):
    """Render a part of a cell.

    Args:
        cell: `whitted.studies.cells.Cell`.
        part: `whitted.studies.cells.Part`.

    Returns:
        A dict: ``sums`` and ``weights``, ``float64`` [H, W, C] and [H, W]; ``timings``, a list of dicts, see `_timed`,
        the last one warm; and ``same_bits``, whether a second run has given the same.

    Raises:
        UsageError: the scene has changed, or can't be rendered.
    """
    _backend.activate(cell.variant)
    scene = cell.scene
    begin = clock.perf_counter()
    loaded, camera = _load_as(scene)
    load_seconds = clock.perf_counter() - begin
    if loaded.hash != scene.hash:
        raise UsageError(f"scene '{scene.label}' has changed since the study began")
    timing, moments = _timed(loaded, camera, cell, part)
    timings, same = [timing | {"load": load_seconds}], True
    if cell.timed and timing["compiled"] + timing["from_disk"]:
        timing, again = _timed(loaded, camera, cell, part)
        same = (again.sums == moments.sums).all() and (again.weights == moments.weights).all()
        timings.append(timing | {"load": None})
    return {
        "sums": moments.sums[0],
        "weights": moments.weights[0],
        "timings": timings,
        "same_bits": bool(same),
    }


def measure_shares(variant, scene, method, evaluations, seed):
    """Return the `whitted.noise.Shares` of one sample by a method of ours, and their picture as bytes of an EXR file.

    Args:
        variant: of Mitsuba.
        scene, method: `Scene`, `Method`.
        evaluations, seed: as for `whitted.noise.noise_shares`.
    """
    _backend.activate(variant)
    loaded, camera = _load_as(scene)
    made, _ = make_integrator(method.integrator)
    found = noise_shares(loaded, made, evaluations=evaluations, seed=seed, sensor=camera)
    return found.to_dict(), encode_exr(found.picture())


def _load_as(scene):
    """A `Scene` loaded, with its sensor."""
    define = tuple(sorted(scene.define.items()))
    return _load(scene.scene, define, scene.sensor, scene.width, scene.height)


@functools.lru_cache(maxsize=SCENES)
def _load(scene, define, sensor, width, height):
    """The loaded scene, and the sensor with a box filter and a film of the size wanted, without a crop."""
    loaded = load(scene, **dict(define))
    sensors = loaded.mitsuba.sensors()
    if sensor >= len(sensors):
        raise UsageError(f"scene '{loaded.name}' has no sensor {sensor}; it has {len(sensors)}")
    own = [int(n) for n in sensors[sensor].film().size()]
    if width or height:
        width = width or max(round(height * own[0] / own[1]), 1)
        height = height or max(round(width * own[1] / own[0]), 1)
    resize(sensors[sensor], width or own[0], height or own[1])
    return loaded, box_sensor(sensors[sensor])


def _methods(loaded, camera, integrator, label, samplers, effects, spp):
    """The methods that an integrator makes with samplers or effects."""
    made, _ = make_integrator(integrator)
    if hasattr(made, "fixed"):
        return [_decided(made, loaded, camera, label, name, len(effects) > 1, spp) for name in effects]
    spec = as_dict(integrator)
    if hasattr(made, "estimate"):
        return [Method(label, spec, None, None, (), None, {n: n for n in spp})]
    if not isinstance(made, mi.SamplingIntegrator):
        raise UsageError(f"integrator '{label}' does not follow eye rays; a study needs one that does")
    accepted = {
        sampler: {n: _sampler(sampler, camera, n).sample_count() for n in spp} for sampler in samplers
    }
    return [Method(f"{label}, {name}", spec, name, None, (), None, accepted[name]) for name in samplers]


def _decided(made, loaded, camera, label, name, is_named, spp):
    """The method of an integrator that has a choice of effects, with what it leaves open decided."""
    made = chosen(made, None if name == "auto" else name)
    begin = clock.perf_counter()
    plan = made.plan(made.world(loaded.mitsuba), camera, loaded.name)
    seconds = clock.perf_counter() - begin
    title = f"{label}, effects {name}" if is_named else label
    return Method(
        title, made.fixed(plan).properties(), None, name, tuple(plan.effects), seconds, {n: n for n in spp}
    )


def _sampler(name, camera, spp):
    """A Mitsuba sampler for as many samples per pixel, or the next number that it takes."""
    if name not in plugin_names("sampler"):
        raise UsageError(f"no sampler is called {name!r}{nearest(name, plugin_names('sampler'))}")
    width, height = (int(n) for n in camera.film().size())
    size = {"width": width, "height": height} if name == "zsobol" else {}
    sampler = mi.load_dict({"type": name} | size)
    sampler.set_sample_count(spp)
    return sampler


def _timed(loaded, camera, cell, part):
    """Render a part, and tell what it took.

    Returns:
        A dict with seconds: ``trace`` (building kernels in Python), ``compile``, ``execute`` (kernels), ``total``
        (wall); and ``compiled`` and ``from_disk``, numbers of kernels; and the ``Moments``.
    """
    window = Window(part.x, part.y, part.width, part.height)
    integrator, _ = make_integrator(cell.method.integrator)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.sync_thread()
        dr.kernel_history_clear()
        begin = clock.perf_counter()
        if cell.method.sampler is None:
            moments = _own_passes(integrator, loaded, camera, window, cell.seed, part)
        else:
            sampler = _sampler(cell.method.sampler, camera, cell.spp)
            passes = SamplerPasses(integrator, loaded.mitsuba, camera, sampler, window, cell.seed, cell.spp)
            passes.run()
            moments = passes.moments()
        total = clock.perf_counter() - begin
        kernels = dr.kernel_history()
    compiled = [
        kernel for kernel in kernels if kernel["type"] == dr.KernelType.JIT and not kernel["cache_hit"]
    ]
    compile_seconds = sum(kernel["codegen_time"] + kernel["backend_time"] for kernel in compiled) / 1000
    execute = sum(kernel["execution_time"] for kernel in kernels) / 1000
    return {
        "trace": max(total - compile_seconds - execute, 0.0),
        "compile": compile_seconds,
        "execute": execute,
        "total": total,
        "compiled": len(compiled),
        "from_disk": sum(bool(kernel.get("cache_disk")) for kernel in kernels),
    }, moments


def _own_passes(integrator, loaded, camera, window, seed, part):
    """The moments of a part by one of our integrators, through a box filter."""
    world = integrator.world(loaded.mitsuba)
    plan = integrator.plan(world, camera, loaded.name)
    channels = 1 if mi.is_monochromatic else 3

    def encode(found, weight, ray):
        return colours(found["radiance"] * weight, ray.wavelengths, channels)

    groups = Replicates(seed, 1)
    passes = TreePasses(integrator, world, camera, plan, window, groups, encode, channels, counted=False)
    step = samples_per_pass(passes.lanes)
    for start in range(part.start, part.stop, step):
        passes.run(start, min(start + step, part.stop))
    return passes.moments(release=True)
