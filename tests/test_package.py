"""What is installed is the package and nothing beside it, and importing it has no side effect."""

import os
import sys
from importlib import metadata
from pathlib import Path

import pytest

import whitted

ROOT = Path(__file__).parents[1]
WHEEL = os.environ.get("WHITTED_TEST_WHEEL") == "1"  # set by `make test`


def test_the_tests_run_on_the_wheel():
    """Elsewhere the package may be the source tree; under ``make test`` it must not be."""
    installed = Path(whitted.__file__).resolve().is_relative_to(Path(sys.prefix).resolve())
    assert installed or not WHEEL
    if WHEEL:
        names = {file.parts[0] for file in metadata.files("whitted")} - {"..", "whitted"}
        assert all(name.endswith(".dist-info") for name in names), names


@pytest.mark.parametrize("folder", ["integrators", "scenes"])
def test_mapped_folders_are_installed_whole(folder):
    import importlib.resources

    for path in (ROOT / folder).rglob("*"):
        if path.is_file() and path.suffix != ".pyc":
            installed = importlib.resources.files(f"whitted.{folder}").joinpath(
                str(path.relative_to(ROOT / folder))
            )
            assert installed.is_file(), path


def test_every_module_is_installed():
    for path in (ROOT / "whitted").rglob("*.py"):
        assert (Path(whitted.__file__).parent / path.relative_to(ROOT / "whitted")).is_file(), path


def test_importing_sets_no_variant(python):
    done = python("import whitted, mitsuba; print(mitsuba.variant(), *sorted(vars(whitted)['__all__']))")
    assert done.stdout.split() == ["None", *sorted(whitted.__all__)]
    assert done.stderr == ""


def test_every_public_name_is_there():
    assert whitted.__version__ == metadata.version("whitted")
    assert set(whitted.__all__) | {"__version__"} <= set(dir(whitted))
    for name in whitted.__all__:
        assert getattr(whitted, name).__doc__
    with pytest.raises(AttributeError, match="no attribute 'rendr'"):
        whitted.rendr  # noqa: B018
