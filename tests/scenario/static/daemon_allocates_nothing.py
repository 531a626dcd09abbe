"""daemon_allocates_nothing.py WAGONSIGHT WAGONSIGHTD: the static daemon with a recorded Kinect reaches /readyz, and its
sealed threads have allocated nothing by then. (That the count sees allocations in a static program is linux_test's.)"""

import pathlib
import re
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

from small_wagon import ROOM, SCENE

SETTINGS = ROOM + """source = "recording"
file = "empty.mcap"
[rig]
blob = "rig.blob"
[pipeline]
learning_s = 1.0
"""
WAIT_S = 120


def get(address, path):
    try:
        with urllib.request.urlopen(address.rstrip("/") + path, timeout=5) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as refusal:
        return refusal.code, refusal.read().decode()


def main():
    wagonsight, wagonsightd = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        pathlib.Path(folder, "scene.toml").write_text(SCENE)
        pathlib.Path(folder, "unit.toml").write_text(SETTINGS)
        subprocess.run([wagonsight, "simulate", "--scene", "scene.toml", "--seconds", "30", "--seed", "1", "--out",
                        "empty.mcap", "--rig-out", "rig.blob"], cwd=folder, check=True)
        daemon = subprocess.Popen([wagonsightd, "--config", "unit.toml", "--port", "0"], cwd=folder,
                                  stdout=subprocess.PIPE, text=True)
        try:
            address = daemon.stdout.readline().strip()
            end, status, text = time.monotonic() + WAIT_S, 0, ""
            while time.monotonic() < end and status != 200:
                status, text = get(address, "/readyz?verbose")
                time.sleep(0.3)
            metrics = get(address, "/metrics")[1]
        finally:
            daemon.terminate()
            daemon.wait(20)
        count = re.search(r"^wagonsight_\w*alloc\w* (\S+)$", metrics, re.M)
        print(f"/readyz {status}, {count.group(0) if count else 'no count of allocations'}")
        if status != 200:
            print(text)
        return 0 if status == 200 and count and float(count.group(1)) == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
