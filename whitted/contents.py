"""What Mitsuba's objects are made of: the shapes and BSDFs of a scene, those of shape groups included."""

import mitsuba as mi


def objects_of(node):
    """Return the Mitsuba objects directly inside ``node`` as a dict from name to object."""

    class Children(mi.TraversalCallback):
        def __init__(self):
            super().__init__()
            self.found = {}

        def put(self, name, value, flags, cpptype=None):
            if isinstance(value, mi.Object):
                self.found[name] = value

        put_object = put

        def put_value(self, name, value, flags, cpptype=None):
            pass

    children = Children()
    node.traverse(children)
    return children.found


def shapes_of(scene):
    """Return all shapes of a scene, the groups and what is in them included."""
    found = {}

    def visit(node):
        for child in objects_of(node).values():
            if isinstance(child, mi.Shape) and child.ptr not in found:
                found[child.ptr] = child
                visit(child)

    visit(scene)
    return list(found.values())


def bsdfs_of(scene):
    """Return all outermost BSDFs of a scene."""
    children = [child for shape in shapes_of(scene) for child in objects_of(shape).values()]
    return list({child.ptr: child for child in children if isinstance(child, mi.BSDF)}.values())
