"""Runs build/release/bin/wagonsightd with config/demo.toml; see scripts/demo."""

import argparse
import json
import pathlib
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parents[2]
DAEMON = ROOT / "build/release/bin/wagonsightd"
READY_WITHIN_S = 120  # a slow machine compiles nothing here, but it renders and learns the background

# What the demo must show: four Kinects at 30 fps each, under 1% dropped, half a core for tracking; with six stereo cameras
# beside them, all sensors at 29 of 30 parts of their rates, and one core.
DROP_SHARE_MAX, RATE_SHARE_MIN = 0.01, 29 / 30
SENSORS, CPU_SHARE_MAX = {"kinects": 4, "all": 10}, {"kinects": 0.5, "all": 1.0}
KINECT_HZ = 30
STEREO_HZ = 3  # the cameras give 14; more cannot be rendered on two cores beside the tracking (see modules/simulate)


def get(port, path):
    with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=5) as answer:
        return answer.read().decode()


def metric(text, name):
    found = re.search(rf"^wagonsight_{name} (\S+)$", text, re.M)
    return float(found.group(1)) if found else float("nan")


def refuse_taken_port(port):
    """Another program's answers must not be taken for the demo's."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            raise SystemExit(f"demo: port {port} cannot be used ({error.strerror}); choose another with --port")


def scene_with_stereo():
    """The demo's scene with six stereo cameras at the rate that can be rendered."""
    stereo = (ROOT / "config/rigs/six_stereo.toml").read_text()
    stereo = stereo.replace('kind = "stereo"', f'kind = "stereo"\nrate_hz = {STEREO_HZ}')
    path = ROOT / "build/demo_scene.toml"
    path.write_text((ROOT / "config/scenes/demo.toml").read_text() + "\n" + stereo)
    return path


def settings_with_port(port, rig):
    """demo.toml as it is, but on the wanted port. Paths in settings start at the file's folder."""
    text = (ROOT / "config/demo.toml").read_text()
    if rig == "all":
        text = re.sub(r'^scene = ".*?"', f'scene = "{scene_with_stereo()}"', text, flags=re.M)
        text = text.replace('name = "demo wagon"', f'name = "demo wagon, stereo at {STEREO_HZ} of 14 Hz"')
    if re.search(r"^\[web\]", text, re.M):
        raise SystemExit("demo: config/demo.toml has a [web] section; set the port there")
    text = re.sub(r'^scene = "(?!/)', f'scene = "{ROOT}/config/', text, flags=re.M)
    path = ROOT / "build/demo.toml"
    path.write_text(f"{text}\n[web]\nport = {port}\n")
    return path


def wait_until_ready(daemon, port):
    deadline, said = time.monotonic() + READY_WITHIN_S, False
    while time.monotonic() < deadline:
        if daemon.poll() is not None:
            raise SystemExit(f"demo: wagonsightd ended with {daemon.returncode}; its last words are above")
        try:
            get(port, "/livez")
            if not said:
                print(f"The page: http://127.0.0.1:{port}/", flush=True)
                said = True
            get(port, "/readyz")
            return
        except (urllib.error.URLError, OSError):
            time.sleep(0.2)
    raise SystemExit(f"demo: not ready after {READY_WITHIN_S} s; see http://127.0.0.1:{port}/readyz?verbose")


def observe(port, seconds):
    """Differences of the counters over the time, and means of what is told of each second."""
    before, started = json.loads(get(port, "/api/v1/sensors"))["sensors"], time.monotonic()
    cpu, verdicts = [], []
    while (left := started + seconds - time.monotonic()) > 0:
        time.sleep(min(1.0, left))
        cpu.append(metric(get(port, "/metrics"), "pipeline_cpu_ratio"))
        verdicts.append(json.loads(get(port, "/api/v1/health"))["verdict"])
    after, passed = json.loads(get(port, "/api/v1/sensors"))["sensors"], time.monotonic() - started
    sensors = []
    for first, last in zip(before, after):
        frames, dropped = last["frames"] - first["frames"], last["dropped"] - first["dropped"]
        sensors.append((last["name"], frames / passed, dropped / max(1, frames + dropped), last["state"]))
    return sensors, sum(cpu) / len(cpu), verdicts


def summarise(port, seconds, rig):
    sensors, cpu, verdicts = observe(port, seconds)
    text = get(port, "/metrics")
    complaints = []
    for name, fps, drop_share, state in sensors:
        print(f"sensor {name:<8} {fps:5.1f} fps, {100 * drop_share:.2f}% dropped, {state}")
        fps_min = RATE_SHARE_MIN * (KINECT_HZ if name.startswith("k") else STEREO_HZ)
        if fps < fps_min or drop_share >= DROP_SHARE_MAX:
            complaints.append(f"sensor {name} is below {fps_min:.1f} fps or drops 1% or more")
    bad = sorted({verdict for verdict in verdicts if verdict != "ok"})
    print(f"tracking        {100 * cpu:.1f}% of one core")
    print(f"memory          {metric(text, 'resident_memory_bytes') / 2**20:.1f} MB resident, "
          f"{metric(text, 'allocations_sealed_total'):.0f} allocations in the data path")
    print(f"people          {metric(text, 'people'):.0f} at the end")
    print(f"health          {verdicts.count('ok')} of {len(verdicts)} seconds ok{', else ' if bad else ''}{', '.join(bad)}")
    if len(sensors) != SENSORS[rig]:
        complaints.append(f"{len(sensors)} sensors instead of {SENSORS[rig]}")
    if not cpu <= CPU_SHARE_MAX[rig]:
        complaints.append(f"tracking takes more than {CPU_SHARE_MAX[rig]} of a core")
    if verdicts[-1] != "ok":
        health = json.loads(get(port, "/api/v1/health"))
        complaints.append(f"health is {health['verdict']}: {health['sentence']}")
    for complaint in complaints:
        print(f"demo: {complaint}", file=sys.stderr)
    return 1 if complaints else 0


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=0)
    parser.add_argument("--port", type=int, default=8080)
    parser.add_argument("--rig", choices=("kinects", "all"), default="kinects")
    options = parser.parse_args()
    refuse_taken_port(options.port)
    # Whoever ends the demo ends the daemon, too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    daemon = subprocess.Popen([DAEMON, "--config", settings_with_port(options.port, options.rig)],
                              stdout=subprocess.DEVNULL)  # its address is told once it answers
    try:
        wait_until_ready(daemon, options.port)
        more = "" if options.rig == "all" else (f"Six stereo cameras beside the four Kinects, at {STEREO_HZ} of their 14 Hz because two "
                                                "cores render no more: ./scripts/demo --rig all")
        if options.seconds > 0:
            failed = summarise(options.port, options.seconds, options.rig)
            print(more, end="\n" if more else "")
            return failed
        print(f"Ctrl-C ends it. {more}".rstrip(), flush=True)
        return daemon.wait()
    except KeyboardInterrupt:
        return 0
    finally:
        daemon.terminate()
        try:
            daemon.wait(timeout=10)
        except subprocess.TimeoutExpired:
            daemon.kill()
            print("demo: wagonsightd did not end when asked to", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
