"""Our plugins are there in each variant, however often and in whatever order variants change."""

import pytest

from whitted import _plugins

SWITCH = """
import {first}, {second}
import mitsuba as mi
classes = []
for variant in ("llvm_ad_rgb", "llvm_ad_mono", "llvm_ad_rgb", "llvm_ad_rgb", "scalar_rgb", "llvm_ad_rgb"):
    mi.set_variant(variant)
    if variant != "scalar_rgb":
        made = mi.load_dict({{"type": "whitted"}})
        assert isinstance(made, mi.SamplingIntegrator), variant
        classes.append(type(made))
assert classes[2] is classes[3], "setting the active variant again is no change"
assert classes[0] is not classes[1]
print("switched")
"""


@pytest.mark.parametrize(("first", "second"), [("whitted", "mitsuba"), ("mitsuba", "whitted")])
def test_variants_may_change_in_one_process(python, first, second):
    from whitted._backend import find_library

    done = python(SWITCH.format(first=first, second=second), DRJIT_LIBLLVM_PATH=find_library())
    assert done.returncode == 0, done.stderr
    assert done.stdout == "switched\n"


def test_a_variant_that_is_active_already_gets_the_plugins(python):
    from whitted._backend import find_library

    first = "import mitsuba as mi; mi.set_variant('llvm_ad_mono')\n"
    script = first + "import whitted; mi.load_dict({'type': 'whitted'})"
    done = python(script, DRJIT_LIBLLVM_PATH=find_library())
    assert done.returncode == 0, done.stderr


def test_the_entry_points_are_our_own_plugins():
    entries = _plugins.entries()
    assert "whitted" in [entry.name for entry in entries]
    for entry in entries:
        assert entry.value.startswith("whitted.")
        assert entry.value.split(".")[-1] == entry.name, "file and XML type agree"


def test_plugins_load_from_xml_and_dict():
    import mitsuba as mi

    needed = {"zsobol": {"width": 8, "height": 8}}
    for entry in _plugins.entries():
        tag = entry.value.split(".")[1].removesuffix("s")
        properties = needed.get(entry.name, {})
        inside = "".join(f'<integer name="{name}" value="{value}"/>' for name, value in properties.items())
        xml = f'<{tag} version="3.0.0" type="{entry.name}">{inside}</{tag}>'
        for made in (mi.load_string(xml), mi.load_dict({"type": entry.name, **properties})):
            assert type(made).__module__ == entry.value


@pytest.mark.parametrize(("version", "theirs"), [("3.9.1", False), ("3.10.0", True), ("3.11.0.dev1", True)])
def test_mitsuba_registers_by_itself_from_3_10(monkeypatch, version, theirs):
    import mitsuba as mi

    monkeypatch.setattr(mi, "__version__", version)
    assert _plugins._mitsuba_registers() is theirs
