"""Shapes that Mitsuba turns inside out, because their ``to_world`` mirrors them.

A sphere's normals then point inwards, and so do those of a mesh that are computed from its faces; those that come with
a mesh are mirrored rightly. Glass becomes a bubble in glass, and an emitter shines inwards.
"""

MESHES = ("obj", "ply", "serialized")  # the plugins that read one


def turned_inside_out(nodes, locate):
    """Return a line for each shape that its transform turns inside out; ``flip_normals`` in the scene says it's known.

    Args:
        nodes: of the parsed scene.
        locate: ``locate(node)`` names the file and line of a node.
    """
    import mitsuba as mi

    lines = []
    for node in nodes:
        props = mi.Properties(node.props)  # a copy: what is read here must not count as read by the plugin
        plugin = props.plugin_name()
        if plugin not in ("sphere", *MESHES) or not _is_mirrored(props) or "flip_normals" in props:
            continue
        if plugin == "sphere" or _has_normals_of_faces(props):
            lines.append(
                f"{locate(node)}: 'to_world' mirrors this '{plugin}', and Mitsuba turns it inside out by that; "
                "'flip_normals' turns it back"
            )
    return tuple(lines)


def _is_mirrored(props):
    if "to_world" not in props:
        return False
    import numpy as np

    matrix = np.array(props["to_world"].matrix, np.float64)[:3, :3]
    return np.linalg.det(matrix / np.abs(matrix).max()) < 0


def _has_normals_of_faces(props):
    """Whether a mirrored mesh is shaded with normals that its faces gave, whose corners now turn the other way."""
    import mitsuba as mi
    import numpy as np

    simple = [name for name in props.keys() if props.type(name).name != "ResolvedReference"]  # noqa: SIM118
    mesh = mi.load_dict({"type": props.plugin_name()} | {name: props[name] for name in simple})
    if not mesh.has_vertex_normals():
        return True
    parameters = mi.traverse(mesh)
    faces, corners, normals = (
        np.array(parameters[name], kind).reshape(-1, 3)
        for name, kind in (("faces", int), ("vertex_positions", float), ("vertex_normals", float))
    )
    a, b, c = (corners[faces[:, k]] for k in range(3))
    along = np.einsum("fi,fi->f", np.cross(b - a, c - a), normals[faces].sum(axis=1))
    return along.sum() > 0  # normals that came with the mesh were mirrored, and contradict its faces
