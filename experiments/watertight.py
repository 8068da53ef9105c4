"""Do rays pass a closed mesh where its triangles meet? 10^8 of them, aimed at shared edges and vertices.

Each goes from the inside to a random point of an edge, or to a vertex. Our own test of ray and triangle has to meet the
mesh exactly once; of Embree, as Mitsuba uses it by default and in its robust mode, the rate of rays that pass is given
with its 95 % interval (Clopper and Pearson's). ``python experiments/watertight.py [--rays N]``; some ten minutes.
"""

import whitted  # noqa: F401, I001, first, since it finds LLVM before drjit looks for one

import argparse

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy.stats import binomtest

from whitted.geometry import triangle
from whitted.hardcases.meshes import icosphere, load_mesh, rays_at_edges, rays_at_vertices

MESHES = (
    (3, 0.0),
    (3, 1000.0),
    (5, 0.0),
    (5, 10.0),
)  # subdivisions of an icosahedron, and how far off 0 it is
BATCH = 1 << 20
AIMS = {"edges": rays_at_edges, "vertices": rays_at_vertices}
SIDES = ("our test: met other than once", "Embree, default: passed", "Embree, robust: passed")


def crossings(o, d, vertices, faces, near):
    """How many of the faces ``near`` it each ray meets, ``UInt32`` [N]; of others it can meet none."""
    place = mi.Float(np.ravel(vertices.T))
    corner = mi.UInt32(np.ravel(faces.T).astype(np.uint32))
    table = mi.UInt32(np.where(near < 0, faces.shape[1], near).astype(np.uint32).ravel())
    lane, lanes = dr.arange(mi.UInt32, near.shape[1]), dr.opaque(mi.UInt32, near.shape[1])

    def step(k, count):
        face = dr.gather(mi.UInt32, table, k * lanes + lane)
        exists = face < faces.shape[1]
        v = [
            dr.gather(mi.Point3f, place, dr.gather(mi.UInt32, corner, 3 * face + i, exists), exists)
            for i in range(3)
        ]
        met, t, *_ = triangle.hit(o, d, *map(mi.Vector3f, v))
        return k + 1, count + dr.select(exists & met & (t > 0), mi.UInt32(1), 0)

    rows = dr.opaque(mi.UInt32, near.shape[0])
    _, count = dr.while_loop((mi.UInt32(0), dr.zeros(mi.UInt32, near.shape[1])), lambda k, _: k < rows, step)
    return count


def failures(aim, vertices, faces, scenes, seed):
    """The numbers of a batch's rays that fail, one for each of ``SIDES``."""
    o, d, near = aim(vertices, faces, BATCH, seed)
    o, d = mi.Vector3f(o), mi.Vector3f(d)
    wrong = [crossings(o, d, vertices, faces, near) != 1]
    wrong += [~scene.ray_test(mi.Ray3f(mi.Point3f(o), d)) for scene in scenes]
    return [int(dr.count(one)[0]) for one in wrong]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rays", type=int, default=10**8, help="in all  [default: 10^8]")
    batches = -(-parser.parse_args().rays // (BATCH * len(MESHES) * len(AIMS)))
    mi.set_variant("llvm_ad_rgb")
    for name, aim in AIMS.items():
        total = np.zeros(len(SIDES), int)
        for number, (levels, offset) in enumerate(MESHES):
            vertices, faces = icosphere(levels)
            vertices = np.float32(vertices + np.array([[offset], [0], [0]]))
            scenes = [load_mesh(vertices, faces, robust) for robust in (False, True)]
            for batch in range(batches):
                total += failures(aim, vertices, faces, scenes, 1000 * number + batch)
        rays = batches * BATCH * len(MESHES)
        print(f"{rays:,} rays at {name}")
        for side, count in zip(SIDES, total.tolist(), strict=True):
            interval = binomtest(count, rays).proportion_ci(0.95)
            print(f"  {side}: {count:,}, {count / rays:.3g} [{interval.low:.2g}, {interval.high:.2g}]")


if __name__ == "__main__":
    main()
