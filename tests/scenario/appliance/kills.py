"""kills.py WAGONSIGHTD SETTINGS [--kills N] [--seed S]   SIGKILL for the daemon on this computer at N random instants, with a
loop that starts it again after a second, as the unit's init does. Its page must be back within 3 s each, and must tell of
the crash. (campaign.py does the same inside the image, where every instruction is emulated and takes its time.)
After every third kill the note of past crashes is taken away, so that the next one is not told of: the fourth within three
minutes would lead to the safe mode."""

import argparse
import os
import pathlib
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request

BACK_S, PATIENCE_S = 3.0, 60.0
LOOP = 'while :; do "$0" --config "$1" --port "$2" --state "$3" & echo $! >"$3/new"; mv "$3/new" "$3/pid"; wait; sleep 1; done'


def get(port, path):
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=10) as answer:
            return answer.read().decode()
    except OSError:
        return None


def wait_until(holds):
    begin = time.monotonic()
    while not holds():
        if time.monotonic() - begin > PATIENCE_S:
            raise SystemExit("kills: the daemon does not come back")
        time.sleep(0.01)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wagonsightd")
    parser.add_argument("settings")
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(1 << 31))
    parser.add_argument("--port", type=int, default=18112)
    options = parser.parse_args()
    draw = random.Random(options.seed)
    print(f"kills: seed {options.seed}", flush=True)
    back, missing = [], 0
    with tempfile.TemporaryDirectory() as folder:
        pid_file = pathlib.Path(folder, "pid")
        loop = subprocess.Popen(["bash", "-c", LOOP, options.wagonsightd, options.settings, str(options.port), folder],
                                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
        try:
            wait_until(lambda: get(options.port, "/livez") is not None)
            for number in range(options.kills):
                time.sleep(draw.uniform(0, 6))
                killed = pid_file.read_text()
                os.kill(int(killed), signal.SIGKILL)
                begin = time.monotonic()
                wait_until(lambda: pid_file.read_text() != killed)
                wait_until(lambda: get(options.port, "/livez") is not None)
                back.append(time.monotonic() - begin)
                if number % 3 != 0 or number == 0:
                    missing += "after a crash" not in (get(options.port, "/api/v1/health") or "")
                if number % 3 == 2:
                    pathlib.Path(folder, "run-record").unlink()
        finally:
            os.killpg(loop.pid, signal.SIGTERM)
    late = sum(seconds > BACK_S for seconds in back)
    print(f"kills: {len(back)}; page back after {statistics.median(back):.2f} s (median), {max(back):.2f} s (longest); "
          f"{late} later than {BACK_S:.0f} s; {missing} not told of")
    return 1 if late or missing else 0


if __name__ == "__main__":
    sys.exit(main())
