"""How a static program was linked, read from its build folder: for the bill of materials and the relink kit."""

import pathlib
import re
import shlex
import subprocess

TOOLCHAIN = pathlib.Path(__file__).resolve().parent
ROOT = TOOLCHAIN.parent


def sysroot(architecture):
    done = subprocess.run([TOOLCHAIN / "sysroot", "--path", architecture], capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(done.stderr.strip())
    return pathlib.Path(done.stdout.strip())


class LinkedProgram:
    """`architecture` and the name of a program that the preset static-ARCHITECTURE has built."""

    def __init__(self, architecture, name):
        self.architecture, self.name = architecture, name
        self.build = ROOT / "build" / f"static-{architecture}"
        self.sysroot = sysroot(architecture)
        self.path = self.build / "bin" / name
        if not self.path.exists():
            raise SystemExit(f"{self.path} is not built; run cmake --build --preset static-{architecture}")
        commands = self.ninja("commands", name).splitlines()
        line = commands[-1].removeprefix(": && ").removesuffix(" && :")
        self.command = shlex.split(line)

    def ninja(self, tool, *arguments):
        return subprocess.run(["ninja", "-C", self.build, "-t", tool, *arguments], capture_output=True, text=True,
                              check=True).stdout

    def link(self, output, *options, folder=None, command=None):
        """Links again, elsewhere; the same bytes come out."""
        words = list(command or self.command)
        words[words.index("-o") + 1] = str(output)
        subprocess.run([*words, *options], cwd=folder or self.build, check=True, capture_output=True, text=True)

    def members(self, folder):
        """Every archive and start file of the link, each with the members that were taken from it."""
        linker_map = pathlib.Path(folder, "link.map")
        self.link(pathlib.Path(folder, "again"), f"-Wl,-Map={linker_map}")
        taken = {}
        for line in linker_map.read_text().splitlines():
            if match := re.match(r"^(\S+\.a)\((\S+)\)$", line):
                taken.setdefault(self.build.joinpath(match[1]).resolve(), set()).add(match[2])
            elif match := re.match(r"^LOAD (\S+\.o)$", line):
                taken.setdefault(self.build.joinpath(match[1]).resolve(), set())
        return taken

    def headers(self):
        """Headers of the sysroot that the program's own sources include, relative to usr/include."""
        objects = {line for line in self.ninja("inputs", self.name).splitlines() if line.endswith(".o")}
        found, wanted = set(), False
        include = f"{self.sysroot}/usr/include/"
        for line in self.ninja("deps").splitlines():
            if not line.startswith(" "):
                wanted = line.split(":")[0] in objects
            elif wanted and line.strip().startswith(include):
                found.add(line.strip().removeprefix(include))
        return found
