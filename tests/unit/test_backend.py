"""Facts about the backend: whatever is imported first, kernels run on a libLLVM that can compile them."""

from __future__ import annotations

import glob
import os
import subprocess
import sys
from pathlib import Path

import OpenImageIO as oiio
import pytest

from renderer.backend import OLDEST_LLVM, find_llvm, versions

ROOT = Path(__file__).resolve().parents[2]
OLD_LLVM = "/usr/lib/*/libLLVM-1[56].so*"


def run(code: str, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Python code in a process of its own, with none of this one's choice of backend."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("DRJIT_", "FREDHOLM_"))}
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=ROOT,
        env=inherited | environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def test_importing_the_package_imports_neither_mitsuba_nor_drjit() -> None:
    done = run("import sys, renderer; sys.exit(any(m in sys.modules for m in ('mitsuba', 'drjit')))")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("first", ["path", "sequence"])
def test_importing_a_part_of_the_equation_first_does_not_choose_an_old_libllvm(first: str) -> None:
    # Dr.Jit looks for libLLVM when it is imported, and old ones abort the process while compiling.
    code = (
        f"import renderer.equation.{first}; from renderer.backend import mitsuba; mi = mitsuba(); import drjit as dr;"
        "print(mi.Float(1, 2) + 1); print(dr.detail.llvm_version()[0] if 'llvm' in mi.variant() else 99)"
    )
    done = run(code)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[-1]) >= OLDEST_LLVM


def test_an_unknown_variant_is_refused_with_the_known_ones() -> None:
    code = (
        "from renderer.backend import mitsuba; from renderer.errors import BackendError\n"
        "try: mitsuba()\nexcept BackendError as e: print(e)"
    )
    done = run(code, FREDHOLM_VARIANT="scalar_rgb")
    assert "FREDHOLM_VARIANT is scalar_rgb; choose one of" in done.stdout
    assert "llvm_ad_rgb" in done.stdout


def test_kernels_run_on_as_many_threads_as_asked_for() -> None:
    code = (
        "from renderer.backend import mitsuba; from renderer.errors import BackendError; import drjit as dr\n"
        "try: print(mitsuba().variant() and dr.thread_count())\nexcept BackendError as e: print(e)"
    )
    assert run(code, FREDHOLM_THREADS="3").stdout.split() == ["3"]
    for bad in ("0", "many", "-2", "1e3", ""):
        assert f"FREDHOLM_THREADS is {bad!r}; give a number from 1 on" in run(code, FREDHOLM_THREADS=bad).stdout


def test_an_exr_map_loads_where_kernels_have_one_thread(tmp_path: Path) -> None:
    # Mitsuba's reader of EXR hands rows to other threads and waits for them, for ever where there are none.
    sky = oiio.ImageBuf(oiio.ImageSpec(16, 8, 3, oiio.FLOAT))
    oiio.ImageBufAlgo.fill(sky, (0.5, 0.5, 0.5))
    assert sky.write(str(tmp_path / "sky.exr"))
    (tmp_path / "scene.xml").write_text(
        """<scene version="3.0.0"><emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>
        <sensor type="perspective"/></scene>"""
    )
    code = (
        "import sys, renderer, drjit as dr\n"
        "image = renderer.render(sys.argv[1], renderer.Target(spp=16), renderer.Settings(width=4, height=4)).mean\n"
        "print(dr.thread_count(), image.min() > 0.4)"
    )
    done = run(code, str(tmp_path / "scene.xml"), FREDHOLM_THREADS="1")
    assert done.stdout.split() == ["1", "True"], done.stderr


def test_the_libllvm_that_is_found_is_a_file() -> None:
    found = find_llvm()
    assert found is None or Path(found).is_file()


def test_versions_name_what_an_image_depends_on() -> None:
    found = versions()
    assert set(found) == {"fredholm", "mitsuba", "drjit", "numpy"}
    assert found["mitsuba"].count(".") == 2


@pytest.mark.skipif(not glob.glob(OLD_LLVM), reason="neither LLVM 15 nor 16 is installed here")
def test_a_dr_jit_that_was_imported_first_with_an_old_llvm_is_refused() -> None:
    code = (
        "import mitsuba as mi\nmi.set_variant('llvm_ad_rgb')\nimport renderer\n"
        "try:\n    renderer.load_scene('cornell-box')\nexcept renderer.errors.BackendError as error:\n    print(error)"
    )
    done = run(code, DRJIT_LIBLLVM_PATH=glob.glob(OLD_LLVM)[0])
    assert "import renderer before drjit" in done.stdout, done.stderr
