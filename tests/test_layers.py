"""Imports point one way, and modules are what Mitsuba's variants and a lazy start need them to be."""

import ast
from pathlib import Path

import pytest

import whitted
from whitted import _plugins

ROOT = Path(__file__).parents[1]
PLUGIN_MODULES = sorted(entry.value for entry in _plugins.entries())
PLUGINS = [
    ROOT / f"{module.removeprefix('whitted.') if '.integrators.' in module else module}".replace(".", "/")
    for module in PLUGIN_MODULES
]
PLUGINS = [path.with_suffix(".py") for path in PLUGINS]
LIBRARY = sorted(set((ROOT / "whitted").rglob("*.py")) - set(PLUGINS))

# Names of mi.* that are the same in every variant.
INVARIANT = {
    "detail",
    "filesystem",
    "LogLevel",
    "logger",
    "set_log_level",
    "variant",
    "variants",
    "__version__",
}


def name(path):
    return str(path.relative_to(ROOT))


def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def package(path):
    """Return the dotted name of the package that a file of the library is in."""
    return ".".join(path.relative_to(ROOT).parent.parts)


def imports(path):
    """Yield the dotted names that a file imports, at any depth, ``from a import b`` as ``a.b``."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parents = package(path).split(".")
                base = ".".join([*parents[: len(parents) - node.level + 1], *([base] if base else [])])
            yield from (f"{base}.{alias.name}" for alias in node.names)


def within(imported, *packages):
    return any(imported == one or imported.startswith(one + ".") for one in packages)


def test_there_is_something_to_check():
    assert len(LIBRARY) > 5
    assert PLUGINS


@pytest.mark.parametrize("path", LIBRARY, ids=name)
def test_the_library_imports_no_plugin_experiment_or_test(path):
    forbidden = [*PLUGIN_MODULES, "integrators", "experiments", "tests"]
    assert not [one for one in imports(path) if within(one, *forbidden)]


@pytest.mark.parametrize("path", [path for path in LIBRARY if "stats" in path.parts], ids=name)
def test_statistics_are_numpy_only(path):
    assert not [one for one in imports(path) if within(one, "mitsuba", "drjit")]
    inside = [one for one in imports(path) if within(one, "whitted")]
    assert all(within(one, "whitted.stats", "whitted.errors") for one in inside), inside


@pytest.mark.parametrize("path", PLUGINS, ids=name)
def test_a_plugin_imports_no_other_plugin(path):
    forbidden = [*PLUGIN_MODULES, "integrators", "experiments", "tests"]
    assert not [one for one in imports(path) if within(one, *forbidden)]


@pytest.mark.parametrize("folder", sorted({path.parent for path in PLUGINS}), ids=name)
def test_every_plugin_is_in_the_entry_point_table(folder):
    assert set(folder.glob("[!_]*.py")) <= set(PLUGINS)


def test_no_submodule_has_the_name_of_a_public_function():
    submodules = {path.stem for path in (ROOT / "whitted").glob("*.py")}
    submodules |= {path.parent.name for path in (ROOT / "whitted").glob("*/__init__.py")}
    assert not submodules & set(whitted.__all__)


@pytest.mark.parametrize("path", LIBRARY, ids=name)
def test_no_value_of_one_variant_is_held(path):
    """At module scope nothing of ``mi`` is read, defaults, decorators and bases included: variants change."""
    assert not list(bound(tree(path)))


def bound(module):
    """Yield the ``mi.NAME`` that are evaluated when the module is imported."""
    aliases = {
        alias.asname or alias.name
        for node in ast.walk(module)
        if isinstance(node, ast.Import)
        for alias in node.names
        if alias.name == "mitsuba"
    }
    pending = list(module.body)
    while pending:
        node = pending.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            arguments = node.args
            pending += [*arguments.defaults, *(default for default in arguments.kw_defaults if default)]
            pending += getattr(node, "decorator_list", [])
            continue
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in aliases:
            if node.attr not in INVARIANT:
                yield f"mi.{node.attr}"
            continue
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "mitsuba":
            yield f"from {node.module}"
        pending += ast.iter_child_nodes(node)


@pytest.mark.parametrize(
    "source",
    [
        "X = mi.Float(0)",
        "class A(mi.BSDF): pass",
        "def f(x=mi.Color3f(0)): pass",
        "@mi.x\ndef f(): pass",
        "f(lambda x=mi.a: 0)",
    ],
)
def test_the_rule_on_variants_sees_what_it_should(source):
    assert list(bound(ast.parse("import mitsuba as mi\n" + source)))
    assert not list(
        bound(ast.parse("import mitsuba as mi\ndef f(): return mi.Float(0)\nmi.set_log_level(0)"))
    )
