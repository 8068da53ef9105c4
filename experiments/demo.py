"""Render two shipped pictures, and prove against Mitsuba's path tracer those that both estimate.

Runs the commands that a user would type, and shows them. Exits with 1 if a proof fails.
"""

import subprocess
import sys
from pathlib import Path

FOLDER = Path("out")
WHITTED = Path(sys.executable).with_name("whitted")
PICTURES = (
    ("render", "whitted_1980", "--png", "-o", FOLDER / "whitted_1980.exr"),
    ("trace", "whitted_1980", "--pixel", "190,300", "-o", FOLDER / "ray_tree.svg"),
    ("render", "cornell_box", "--spp", "64", "--png", "-o", FOLDER / "cornell_box.exr"),
)
PROOFS = (  # at max_depth=2 both trace direct light alone; the other scenes say why in their first comments
    (
        *("check", "cornell_box", "-D", "width=256", "-D", "height=256"),
        *("--integrator", "whitted:max_depth=2", "--reference", "path:max_depth=2"),
    ),
    ("check", "match_diffuse", "-D", "width=128", "-D", "height=128"),
    ("check", "match_specular", "-D", "width=128", "-D", "height=128"),
)


def run(command):
    """Show a command and run it; return its exit code."""
    words = [str(word) for word in command]
    print("\n$ whitted " + " ".join(words), flush=True)
    return subprocess.run([WHITTED, *words], check=False).returncode


def main():
    FOLDER.mkdir(exist_ok=True)
    failed = [command for command in (*PICTURES, *PROOFS) if run(command) != 0]
    print("\nPictures:")
    for path in sorted(FOLDER.iterdir()):
        print(f"  {path.resolve()}")
    for command in failed:
        print("failed: whitted " + " ".join(map(str, command)), file=sys.stderr)
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
