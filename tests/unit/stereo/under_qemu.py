"""Builds the matcher's tests for aarch64 and runs them under qemu-user: the NEON kernels give the scalar's bytes.

  under_qemu.py BUILD_FOLDER        exits 77 with one sentence when the cross compiler or qemu-user is not installed
"""

import pathlib
import shutil
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[3]
GTEST = pathlib.Path("/usr/src/googletest")
SKIPPED = 77

STEREO = ["kernels_scalar", "kernels_dispatch", "kernels_neon", "matcher", "matcher_rows", "speckle"]
TESTS = ["kernels_test", "matcher_test"]


def sources():
    yield from (ROOT / f"modules/stereo/{name}.cpp" for name in STEREO)
    yield from (ROOT / f"tests/unit/stereo/{name}.cpp" for name in TESTS)
    yield GTEST / "googletest/src/gtest-all.cc"
    yield GTEST / "googlemock/src/gmock-all.cc"
    yield GTEST / "googlemock/src/gmock_main.cc"


def newest_header():
    folders = [ROOT / "modules/stereo", ROOT / "modules/base", ROOT / "modules/frame", ROOT / "tests/unit/stereo"]
    return max(path.stat().st_mtime for folder in folders for path in folder.glob("*.h"))


def skip(sentence):
    print(f"skipped: {sentence}")
    sys.exit(SKIPPED)


def main():
    compiler = shutil.which("aarch64-linux-gnu-g++")
    emulator = shutil.which("qemu-aarch64-static") or shutil.which("qemu-aarch64")
    if compiler is None or emulator is None:
        skip("NEON is not tried; install g++-aarch64-linux-gnu and qemu-user-static for it")
    if not (GTEST / "googletest/src/gtest-all.cc").exists():
        skip("NEON is not tried; install googletest, whose sources are built for aarch64")
    folder = pathlib.Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    flags = ["-std=c++20", "-O2", "-ffp-contract=off", f"-I{ROOT}/modules", f"-I{ROOT}/tests", f"-I{ROOT}/tests/unit/stereo",
             "-isystem", "/usr/include/eigen3", f"-I{GTEST}/googletest", f"-I{GTEST}/googlemock",
             f"-I{GTEST}/googletest/include", f"-I{GTEST}/googlemock/include",
             f'-DWAGONSIGHT_SOURCE_DIR="{ROOT}"', *expected_flags()]
    objects, header_time = [], newest_header()
    for source in sources():
        target = folder / f"{source.stem}.o"
        objects.append(target)
        if target.exists() and target.stat().st_mtime > max(source.stat().st_mtime, header_time):
            continue
        subprocess.run([compiler, *flags, "-c", source, "-o", target], check=True)
    program = folder / "stereo_test_aarch64"
    subprocess.run([compiler, "-static", *objects, "-o", program, "-lpthread"], check=True)
    return subprocess.run([emulator, program, "--gtest_brief=1"]).returncode


def expected_flags():
    """tl/expected.hpp is a header of /usr/include, which the cross compiler does not search."""
    header = pathlib.Path("/usr/include/tl/expected.hpp")
    if not header.exists():
        skip("NEON is not tried; install libexpected-dev")
    link = pathlib.Path(sys.argv[1]) / "include"
    link.mkdir(parents=True, exist_ok=True)
    if not (link / "tl").exists():
        (link / "tl").symlink_to(header.parent)
    return [f"-I{link}"]


if __name__ == "__main__":
    sys.exit(main())
