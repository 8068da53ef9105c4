"""The bounded lights of a scene as one: a primitive is chosen by the tree, and a point on it by solid angle."""

import drjit as dr
import mitsuba as mi
import numpy as np

from whitted.lights import disk, few, rectangle, sphere, triangle
from whitted.lights.primitives import (
    DISK,
    MITSUBA,
    POINT,
    RECTANGLE,
    SPHERE,
    TRIANGLE,
    is_delta,
    primitives_of,
)
from whitted.lights.sample import LightSample
from whitted.lights.tree import LightTree
from whitted.transport import when

NOT_SAMPLED = 0xFFFFFFFF
MARGIN = 1e-6  # relative, of what counts as a light's own surface
FAR = 2.0  # sizes; from there a light is sampled by area
CLOSED = {RECTANGLE, TRIANGLE, DISK, SPHERE}
SHAPES = {RECTANGLE: rectangle, TRIANGLE: triangle, DISK: disk, SPHERE: sphere}


class BoundedLights:
    """All emitters of a scene that lie within bounds.

    Attributes:
        count: how many primitives there are.
        is_closed: the unoccluded irradiance of all of them is known, see ``irradiance``.
        is_plain: at a diffuse surface none that a ray can meet needs a second technique beside ``sample``.
        is_hittable: a ray can meet some.
        only_met: there are others that can't be sampled, so that only rays that meet them find their light.
        has_deltas: a ray can't meet some.
        needs_choice, needs_point: ``sample`` uses ``choice``, and ``u``.

    Args:
        scene: ``mi.Scene``.
        as_points: see `primitives_of`.
    """

    def __init__(self, scene, as_points=False):
        parts = primitives_of(scene, as_points)
        self.scene, self.emitters = scene, scene.emitters()
        self.count, self.as_points = len(parts), as_points
        self.every_kind = [int(kind) for kind in parts.kind]
        self.kinds = sorted(set(self.every_kind))
        self.is_few = self.count <= few.MOST
        self.is_closed = self.count > 0 and self.is_few and set(self.kinds) <= CLOSED
        met = [
            kind
            for kind, e in zip(parts.kind, parts.emitter, strict=True)
            if not is_delta(self.emitters[int(e)])
        ]
        self.has_deltas = len(met) < self.count
        self.only_met = parts.only_met
        self.is_hittable = (bool(met) or self.only_met) and not as_points
        self.is_plain = MITSUBA not in met and not self.only_met
        self.needs_choice, self.needs_point = self.count > 1, bool(met) and not as_points
        self.boxes = list(zip(parts.lower, parts.upper, strict=True))
        if not self.count:
            return
        self.kind, self.emitter, self.shape = map(self._column, (parts.kind, parts.emitter, parts.shape))
        self.geometry = [self._column(column) for column in parts.geometry.T]
        self.colour = [self._column(column) for column in parts.radiance.T]
        first = np.full(int(parts.shape.max()) + 1, NOT_SAMPLED, np.uint32)
        for leaf in reversed(range(self.count)):
            first[parts.shape[leaf]] = leaf
        first[0] = NOT_SAMPLED
        self.first, self.shapes = mi.UInt32(first.tolist()), dr.opaque(mi.UInt32, len(first))
        cone = parts.axis, parts.cos_spread, np.zeros(self.count)
        choice = few.FewLights if self.is_few else LightTree
        self.choice = choice(parts.lower, parts.upper, parts.power, *cone)

    def _column(self, values):
        """Numbers of all lights in memory, so that one kernel serves all values.

        Of few lights each by itself, as to select is cheaper than to gather. Else from a list, since NumPy's memory may
        lie unaligned, which makes another kernel.
        """
        dtype = mi.Float if values.dtype.kind == "f" else mi.UInt32
        if self.is_few:
            return [dr.opaque(dtype, value) for value in values.tolist()]
        return dtype(values.tolist())

    @property
    def shares_type(self):
        """The type of what `shares` returns, or None."""
        return self.choice.shares_type if self.is_few and self.count > 1 else None

    def shares(self, p, n, response=None):
        """Return what a choice at ``p`` has to know and `pdf` later: see ``FewLights``. None: nothing."""
        return self.choice.shares(p, n, response) if self.is_few else None

    def sample(self, si, n, u, choice, active, shares=None):
        """Sample a direction towards one of the lights, without regard to what lies between.

        Args:
            si: ``SurfaceInteraction3f`` [N], the receiver.
            n: ``Vector3f`` [N], unit, the side of the receiver that light can come from, or 0 if it is both.
            u: ``Point2f`` [N] in [0, 1)^2.
            choice: ``Float`` [N] in [0, 1), of the light.
            shares: what `shares` returned for the receiver.

        Returns:
            `LightSample`.
        """
        if self.is_few:
            leaf, probability, valid = self.choice.sample(shares, choice)
        else:
            leaf, probability, _, valid = self.choice.sample(si.p, n, choice, active)
        valid &= active
        geometry, kind = self._geometry(leaf, valid), self._gather(self.kind, leaf, valid)
        shape = self._gather(self.shape, leaf, valid)
        found = mi.Vector3f(0, 0, 1), mi.Point3f(0), mi.Spectrum(0), mi.Float(0)
        for one in self.kinds:
            here = valid & (kind == one)
            if one == MITSUBA:
                new = self._by_mitsuba(leaf, si, u, here)
            elif one == POINT:
                new = self._at_point(leaf, geometry, si, here)
            else:
                q, d, pdf = _sample(one, geometry, si.p, n, u, here)
                lit = here & (pdf > 0) & _faces(one, geometry, si.p, shape == _shape_of(si))
                new = d, q, dr.select(lit, self._radiance(leaf, si, lit) / pdf, 0), pdf
            if len(self.kinds) > 1:
                new = tuple(dr.select(here, a, b) for a, b in zip(new, found, strict=True))
            found = new
        d, target, weight, pdf = found
        weight = dr.select(valid, weight * dr.rcp(probability), 0)
        return LightSample(d, target, weight, pdf * probability, shape)

    def pdf(self, si, p, n, active, shares=None):
        """Return the density (``Float``) with which ``sample`` at ``p``, ``n`` finds the point ``si`` of a light."""
        shape = _shape_of(si)
        leaf = dr.gather(mi.UInt32, self.first, shape, active & (shape < self.shapes))
        active = active & (shape < self.shapes) & (leaf != NOT_SAMPLED)
        if TRIANGLE in self.kinds:
            leaf += dr.select(self._gather(self.kind, leaf, active) == TRIANGLE, si.prim_index, 0)
        geometry, kind = self._geometry(leaf, active), self._gather(self.kind, leaf, active)
        density = mi.Float(0)
        for one in self.kinds:
            here = active & (kind == one)
            by_us = one != MITSUBA
            new = _pdf(one, geometry, p, n, si.p, here) if by_us else self._pdf_by_mitsuba(leaf, si, p, here)
            density = dr.select(here, new, density)
        if self.is_few:
            probability = self.choice.probability(shares, leaf)
        else:
            probability = self.choice.probability(leaf, p, n, active)
        return dr.select(active, density * probability, 0)

    def irradiance(self, si, n, active):
        """Return the irradiance (``Spectrum``) from all lights if nothing lies between; only where ``is_closed``."""
        E = mi.Spectrum(0)
        for number in range(self.count):
            kind, geometry = self.every_kind[number], self._geometry(number, True)
            own = self._gather(self.shape, number, True) == _shape_of(si)
            seen = active & _faces(kind, geometry, si.p, own)
            value = SHAPES[kind].irradiance(
                *_arguments(kind, geometry), si.p, n, **_side(kind, geometry, si.p)
            )
            E += dr.select(seen, value * self._radiance(number, si, seen), 0)
        return E

    def _gather(self, column, leaf, active):
        if self.is_few:
            return few.pick(column, leaf)
        return dr.gather(type(column), column, leaf, active)

    def _geometry(self, leaf, active):
        return [self._gather(column, leaf, active) for column in self.geometry]

    def _light(self, leaf, active):
        """The emitters of primitives: one object or an array of pointers."""
        if len(self.emitters) == 1:
            return self.emitters[0]
        number = mi.UInt32(self._gather(self.emitter, leaf, active))
        return dr.gather(mi.EmitterPtr, self.scene.emitters_dr(), number, active)

    def _radiance(self, leaf, si, active):
        """The radiance (``Spectrum``) of uniform lights."""
        if not mi.is_spectral:
            return mi.Spectrum([self._gather(column, leaf, active) for column in self.colour])
        at = dr.zeros(mi.SurfaceInteraction3f)
        at.wi, at.wavelengths = mi.Vector3f(0, 0, 1), si.wavelengths
        return self._light(leaf, active).eval(at, active)

    def _at_point(self, leaf, geometry, si, active):
        q, normal = mi.Point3f(geometry[:3]), mi.Vector3f(geometry[3:6])
        d = dr.normalize(q - si.p)
        cosine = dr.select(dr.all(normal == 0), 1, dr.maximum(-dr.dot(d, normal), 0))
        intensity = self._radiance(leaf, si, active) * geometry[6] * cosine
        return d, q, intensity * dr.rcp(dr.squared_norm(q - si.p)), mi.Float(0)

    def _by_mitsuba(self, leaf, si, u, active):
        ds, weight = self._light(leaf, active).sample_direction(si, u, active)
        pdf = dr.select(ds.delta, 0, ds.pdf)
        return ds.d, ds.p, dr.select(active & (ds.pdf > 0), weight, 0), pdf

    def _pdf_by_mitsuba(self, leaf, si, p, active):
        receiver = dr.zeros(mi.Interaction3f)
        receiver.p, receiver.time, receiver.wavelengths = p, si.time, si.wavelengths
        ds = mi.DirectionSample3f(self.scene, si, receiver)
        return self._light(leaf, active).pdf_direction(receiver, ds, active)


def _shape_of(si):
    """The registry number of the shape at ``si``, 0 if there is none."""
    return dr.reinterpret_array(mi.UInt32, si.shape)


def _sample(kind, geometry, p, n, u, active):
    """Sample a point of a primitive from ``p``: by solid angle if it is near, else by area, which is cheaper."""
    light = _arguments(kind, geometry)

    def exact(q, d, pdf):
        q, d, _, pdf = SHAPES[kind].sample(*light, p, n, u, **_side(kind, geometry, p))
        return mi.Point3f(q), mi.Vector3f(d), pdf

    if kind == SPHERE:
        return exact(*[None] * 3)
    first, second, third = light
    middle, size2, area_normal = _extent(kind, light)
    if kind == RECTANGLE:
        q = first + second * u.x + third * u.y
    elif kind == TRIANGLE:
        t = mi.warp.square_to_uniform_triangle(u)
        q = first + (second - first) * t.x + (third - first) * t.y
    else:
        t = mi.warp.square_to_uniform_disk_concentric(u) * third
        q = first + mi.Frame3f(second).to_world(mi.Vector3f(t.x, t.y, 0))
    near = active & _is_near(p, middle, size2)
    v = mi.Vector3f(q - p)
    d = v * dr.rsqrt(dr.squared_norm(v))
    return when(near, exact, mi.Point3f(q), d, _area_pdf(v, area_normal))


def _pdf(kind, geometry, p, n, q, active):
    """The density with which `_sample` gives the direction from ``p`` to the point ``q`` of a primitive."""
    light = _arguments(kind, geometry)
    if kind == SPHERE:
        return sphere.pdf(*light, p, n, q, **_side(kind, geometry, p))
    middle, size2, area_normal = _extent(kind, light)
    near = active & _is_near(p, middle, size2)
    return when(near, lambda pdf: SHAPES[kind].pdf(*light, p, n, q), _area_pdf(q - p, area_normal))


def _is_near(p, middle, size2):
    """Whether a flat light is so near that it pays to sample it by solid angle."""
    return dr.squared_norm(middle - p) < dr.square(FAR) * size2


def _area_pdf(v, area_normal):
    """The density by solid angle of the direction ``v`` to a point that is uniform over a flat light's area."""
    across = dr.abs(dr.dot(v, area_normal))
    d2 = dr.squared_norm(v)
    return dr.select(across > 0, d2 * dr.sqrt(d2) / across, 0)


def _extent(kind, light):
    """The middle of a flat light, its squared size, and its normal with the length of its area."""
    first, second, third = light
    if kind == DISK:
        return first, dr.square(2 * third), second * (dr.pi * dr.square(third))
    if kind == TRIANGLE:
        x, y = second - first, third - first
        longest = dr.maximum(dr.maximum(dr.squared_norm(x), dr.squared_norm(y)), dr.squared_norm(y - x))
        return first + (x + y) / 3, longest, dr.cross(x, y) / 2
    return (
        first + (second + third) / 2,
        dr.squared_norm(second) + dr.squared_norm(third),
        dr.cross(second, third),
    )


def _arguments(kind, geometry):
    """The columns of a primitive as the functions of its shape want them."""
    if kind == SPHERE:
        return mi.Point3f(geometry[:3]), geometry[3]
    first, second, third = (mi.Vector3f(geometry[i : i + 3]) for i in (0, 3, 6))
    if kind == DISK:
        return mi.Point3f(first), second, geometry[6]
    if kind == TRIANGLE:
        return mi.Point3f(first), mi.Point3f(second), mi.Point3f(third)
    return mi.Point3f(first), second, third


def _side(kind, geometry, p):
    """What the functions of a sphere have to be told of points on it: they are on the side that is lit."""
    return {"inside": _is_inside(geometry, p)} if kind == SPHERE else {}


def _is_inside(geometry, p):
    """Whether ``p`` is inside of a sphere, or on one that is lit from inside."""
    return sphere.is_inside(*_arguments(SPHERE, geometry), p, narrow=geometry[4] > 0)


def _faces(kind, geometry, p, own):
    """Whether a light emits towards ``p``; points of a flat light's plane, up to rounding, count as behind it.

    ``own`` (``Bool`` [N]): ``p`` is on the light itself.
    """
    if kind == SPHERE:
        emits_outwards = geometry[4] > 0
        return (_is_inside(geometry, p) ^ emits_outwards) & ~(own & emits_outwards)
    first, second, third = _arguments(kind, geometry)
    normal = {
        RECTANGLE: lambda: dr.cross(second, third),
        TRIANGLE: lambda: dr.cross(second - first, third - first),
        DISK: lambda: second,
    }[kind]()
    v = p - first
    return dr.dot(normal, v) > MARGIN * dr.norm(normal) * (dr.norm(v) + dr.norm(p))
