"""The rays of a tree in space: an orthographic projection onto the plane in which they spread the most.

The plane is that of the two largest principal components of the eye and the hit points; the vertical axis of
the drawing is the scene's y axis, as far as the plane holds it. What is very far is drawn nearer. Left out:
hidden lines, and the surfaces themselves.
"""

import numpy as np

from whitted import svg
from whitted.words import KINDS

STUB = 34.0  # length in the drawing of a ray that goes on for ever
FAR = 2.5  # an eye or light further away than so many sizes of the rest is drawn at that distance


def draw(tree, x, y, size, style):
    """Return the SVG of the panel.

    Args:
        tree: a ray tree, as for `whitted.drawing.to_svg`.
        x, y, size: the panel's corner, and its width and height.
        style: has ``shadow_style(shadow)``, ``stroke_width(throughput)`` and ``surfaces``, a dict from
            surface to colour.
    """
    traced = [node for node in tree.nodes if not node["dropped"]]
    hits = [node["position"] for node in traced if node["position"] is not None]
    hits = np.array(hits, float).reshape(-1, 3)
    eye = np.array(traced[0]["origin"], float)
    away = np.array(traced[0]["direction"], float)
    points, eye, reach = _extent(traced, hits, eye)
    axes = best_axes(np.array([eye, *hits]), away)
    flat = points @ axes.T
    low, high = flat.min(axis=0), flat.max(axis=0)
    margin = STUB + 14
    room = np.array(size) - 2 * margin
    scale = float(np.min(room / np.maximum(high - low, 1e-6 * max(float(np.max(high - low)), 1e-30))))
    middle, centre = (low + high) / 2, np.array([x + size[0] / 2, y + size[1] / 2])

    def project(point):
        u, v = (axes @ np.asarray(point, float) - middle) * scale
        return np.array([centre[0] + u, centre[1] - v])

    def stub(start, direction):
        u, v = axes @ np.asarray(direction, float)
        return start + STUB * np.array([u, -v])

    marks, ends = [], {}
    for node in traced:
        marks += [_shadow(node, shadow, project, stub, reach, style) for shadow in node["shadow"]]
    for node in traced:
        start = project(node["origin"] if node["parent"] is not None else eye)
        colour, width = KINDS[node["kind"]].colour, style.stroke_width(node["throughput"])
        escapes = node["position"] is None
        end = ends[node["id"]] = stub(start, node["direction"]) if escapes else project(node["position"])
        marks.append((svg.arrow if escapes else svg.line)(start, end, stroke=colour, stroke_width=width))
    for node in traced:
        if node["position"] is not None:
            fill = style.surfaces[node["shape"]]
            marks.append(svg.circle(*ends[node["id"]], 3.5, fill=fill, stroke=svg.PAPER))
    frame = svg.element("rect", x=x, y=y, width=size[0], height=size[1], rx=6, fill="#fafafa", stroke="#ddd")
    words = "the rays in space" + (", seen from above" if abs(axes[1, 1]) < 0.45 else "")
    caption = svg.text(x + 12, y + 20, words, size=12, anchor="start", fill=svg.FAINT)
    return "".join([frame, caption, *marks, *_numbers(ends), eye_mark(*project(eye))])


def best_axes(points, away):
    """Return the drawing's horizontal and vertical axes, [2, 3], orthonormal, for points [N, 3].

    The direction ``away`` from the eye goes to the right, or to the top where the scene is seen from above.
    Where the points leave the plane open, as a single ray does, it is that of ``away`` and the y axis.
    """
    up, away = np.array([0.0, 1.0, 0.0]), np.asarray(away, float)
    spread = points - points.mean(axis=0)
    covariance = spread.T @ spread / max(float(np.sum(spread**2)), 1e-30)
    covariance += 1e-3 * np.outer(away, away) + 1e-4 * np.outer(up, up) + 1e-5 * np.diag([1.0, 0, 0])
    normal = np.linalg.eigh(covariance)[1][:, 0]
    upright = abs(normal @ up) < 0.9
    vertical, right = (up, away) if upright else (away, np.cross(away, up))
    vertical = vertical - normal * (normal @ vertical)
    vertical /= max(float(np.linalg.norm(vertical)), 1e-30)
    horizontal = np.cross(vertical, normal)
    return np.array([horizontal if horizontal @ right >= 0 else -horizontal, vertical])


def eye_mark(x, y):
    """Return a small eye."""
    left, right = f"{x - 13:.1f},{y:.1f}", f"{x + 13:.1f},{y:.1f}"
    lid = f"M{left} Q{x:.1f},{y - 13:.1f} {right} Q{x:.1f},{y + 13:.1f} {left}Z"
    outline = svg.element("path", d=lid, fill=svg.PAPER, stroke=svg.INK, stroke_width=1.5)
    return outline + svg.circle(x, y, 4.5, fill=svg.INK)


def light_mark(x, y, fill, stroke):
    """Return a small sun."""
    beams = []
    for angle in np.arange(8) * np.pi / 4:
        direction = np.array([np.cos(angle), np.sin(angle)])
        start, end = (x, y) + 5.5 * direction, (x, y) + 8.0 * direction
        beams.append(svg.line(start, end, stroke=stroke, stroke_width=1.3))
    return "".join(beams) + svg.circle(x, y, 3.8, fill=fill, stroke=stroke, stroke_width=1.2)


def _extent(traced, hits, eye):
    """Return the points to be seen, the eye moved near where it is far, and how far a light may be."""
    if len(hits) == 0:
        return np.array([eye, eye + traced[0]["direction"]]), eye, (eye, 0.0)
    middle = hits.mean(axis=0)
    size = float(np.linalg.norm(np.ptp(hits, axis=0)))
    away = eye - hits[0]
    distance = float(np.linalg.norm(away))
    if 0 < FAR * size < distance:
        eye = hits[0] + away * (FAR * size / distance)
    size = max(size, float(np.linalg.norm(eye - hits[0])))
    lights = [s["target"] for node in traced for s in node["shadow"] if s["target"] is not None]
    near = [light for light in lights if np.linalg.norm(np.array(light) - middle) <= FAR * size]
    return np.array([eye, *hits, *near], float), eye, (middle, FAR * size)


def _shadow(node, shadow, project, stub, reach, style):
    """Return a shadow ray: to its light, or a stub of it where that is far or infinitely far."""
    start = project(node["position"])
    stroke = style.shadow_style(shadow)
    target = shadow["target"]
    if target is not None and np.linalg.norm(np.asarray(target) - reach[0]) <= reach[1]:
        end = project(target)
        return svg.line(start, end, **stroke) + light_mark(*end, "#ffe27a", "#b98900")
    return svg.arrow(start, stub(start, shadow["direction"]), size=5.0, **stroke)


def _numbers(ends):
    """Return the numbers of the nodes, as in the tree, beside their points, where there is room."""
    marks, taken = [], list(ends.values())
    for key, point in ends.items():
        for corner in ((9, -7), (9, 8), (-9, 8), (-9, -7)):
            place = point + corner
            if all(np.abs(place - other).max() > 8.5 for other in taken):
                taken.append(place)
                marks.append(svg.text(place[0], place[1] + 3, key, size=9, halo=True))
                break
    return marks
