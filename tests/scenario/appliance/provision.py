"""provision.py WAGONSIGHT FOLDER [all]   makes what the campaign provisions its units with: a simulated wagon with one Kinect
and two passengers, recorded at two frames a second (qemu is not real time) and played again and again, with its calibration.
With `all`: four Kinects and six stereo cameras at one image every two seconds, for how much memory that takes."""

import pathlib
import re
import subprocess
import sys

WAGON = """
[wagon]
length = 6.0
width = 2.7
height = 2.4
[[zone]]
name = "saloon"
polygon = [[0.0, 0.0], [6.0, 0.0], [6.0, 2.7], [0.0, 2.7]]
capacity = 12
"""
SCENE = WAGON + """
[[sensor]]
name = "k0"
kind = "kinect"
position = [0.1, 1.35, 2.2]
look_at = [4.0, 1.35, 0.6]
rate_hz = 2.0
[[passenger]]
name = "walker"
height = 1.75
start = [2.0, 0.9]
[[passenger.do]]
at = 2.5
act = "walk"
to = [3.6, 1.8]
[[passenger.do]]
at = 12.0
act = "walk"
to = [2.0, 0.9]
[[passenger]]
name = "standing"
height = 1.62
start = [3.0, 1.4]
"""
SETTINGS = """[unit]
name = "campaign"
""" + WAGON + """
SENSORS
[rig]
blob = "rig.blob"
[pipeline]
learning_s = 2.0
fps_expected = RATE
[web]
host = "0.0.0.0"
trusted_network = true
"""
SENSOR = """
[[sensor]]
name = "{}"
kind = "{}"
source = "recording"
file = "journey.mcap"
loop = true
"""
SECONDS, SECONDS_ALL = 20, 6
CONFIG = pathlib.Path(__file__).resolve().parents[3] / "config"


def everything():
    """The scene walk with the six stereo cameras, slowly."""
    scene = (CONFIG / "scenes/walk.toml").read_text() + (CONFIG / "rigs/six_stereo.toml").read_text()
    return re.sub(r'(kind = "(kinect|stereo)")', r"\1\nrate_hz = 0.5", scene)


def main():
    wagonsight, folder, is_all = sys.argv[1], pathlib.Path(sys.argv[2]), sys.argv[3:] == ["all"]
    folder.mkdir(parents=True, exist_ok=True)
    scene = folder.parent / f"{folder.name}.scene.toml"
    scene.write_text(everything() if is_all else SCENE)
    sensors = re.findall(r'\[\[sensor\]\]\s*name = "(\w+)"\s*kind = "(\w+)"', scene.read_text())
    subprocess.run([wagonsight, "simulate", "--scene", scene, "--seconds",
                    str(SECONDS_ALL if is_all else SECONDS), "--seed", "7", "--out",
                    folder / "journey.mcap", "--rig-out", folder / "rig.blob"], check=True)
    settings = SETTINGS.replace("SENSORS", "".join(SENSOR.format(*sensor) for sensor in sensors))
    (folder / "unit.toml").write_text(settings.replace("RATE", "0.5" if is_all else "2.0"))


if __name__ == "__main__":
    main()
