"""healing.py WAGONSIGHTD SETTINGS: plays the service manager of the real daemon. Ready and alive are told; a thread that is
stopped silences the heartbeat, and only that; a crash is told by the next run's health, with its reason; the fourth crash in a
row leads to the safe mode, which serves the page and says why."""

import ctypes
import json
import os
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

PTRACE_SEIZE, PTRACE_INTERRUPT, PTRACE_DETACH = 0x4206, 0x4207, 17
PATIENCE_S = 120


class Unit:
    def __init__(self, program, settings, folder):
        self.arguments = [program, "--config", settings, "--port", "0", "--state", str(folder)]
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(folder / "notify"))
        self.environment = dict(os.environ, NOTIFY_SOCKET=str(folder / "notify"))

    def start(self):
        self.process = subprocess.Popen(self.arguments, env=self.environment, stdout=subprocess.PIPE, text=True)
        self.address = self.process.stdout.readline().strip()
        self.hear("READY=1")

    def end(self, which):
        self.process.send_signal(which)
        self.process.wait(60)
        self.process.stdout.close()

    def hear(self, wanted, patience_s=PATIENCE_S):
        """What was heard up to the word wanted; None when it does not come."""
        heard, end = "", time.monotonic() + patience_s
        while wanted not in heard:
            self.socket.settimeout(max(0.01, end - time.monotonic()))
            try:
                heard += self.socket.recv(4096).decode()
            except TimeoutError:
                return None
        return heard

    def get(self, path):
        end = time.monotonic() + PATIENCE_S
        while True:
            try:
                with urllib.request.urlopen(self.address + path, timeout=5) as answer:
                    return answer.status, answer.read().decode()
            except urllib.error.HTTPError as refusal:
                return refusal.code, refusal.read().decode()
            except OSError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.1)

    def faults(self):
        return {fault["id"]: fault for fault in json.loads(self.get("api/v1/health")[1])["faults"]}

    def thread(self, name):
        for task in pathlib.Path(f"/proc/{self.process.pid}/task").iterdir():
            if (task / "comm").read_text().strip() == name:
                return int(task.name)
        raise SystemExit(f"no thread is called {name}")


def check(holds, sentence):
    print("ok  " if holds else "FAIL", sentence, flush=True)
    if not holds:
        raise SystemExit(1)


def hang_a_thread(unit):
    libc = ctypes.CDLL(None, use_errno=True)
    thread = unit.thread("tracking")
    if libc.ptrace(PTRACE_SEIZE, thread, None, None) != 0:
        print("left out: threads cannot be stopped here:", os.strerror(ctypes.get_errno()))
        return
    libc.ptrace(PTRACE_INTERRUPT, thread, None, None)
    os.waitpid(thread, 0x40000000)  # __WALL
    check(unit.hear("stands still", 60) is not None, "a thread that hangs is noticed")
    while unit.hear("WATCHDOG=1", 0.05):
        pass  # what was sent before
    check(unit.hear("WATCHDOG=1", 3) is None, "and the heartbeat stops")
    libc.ptrace(PTRACE_DETACH, thread, None, None)
    check(unit.hear("WATCHDOG=1") is not None, "it comes back with the thread")


def main():
    with tempfile.TemporaryDirectory() as name:
        unit = Unit(sys.argv[1], sys.argv[2], pathlib.Path(name))
        try:
            unit.start()
            check(unit.hear("WATCHDOG=1") is not None, "a well unit says that it is ready and alive")
            check("restarted" not in unit.faults(), "nothing is told of a crash that was none")
            hang_a_thread(unit)
            unit.end(signal.SIGTERM)
            unit.start()
            check("restarted" not in unit.faults(), "being told to stop is no crash")
            unit.end(signal.SIGSEGV)
            unit.start()
            cause = unit.faults()["restarted"]["cause"]
            check("SIGSEGV" in cause, f"a crash is told: {cause}")
            for _ in range(3):
                unit.end(signal.SIGKILL)
                unit.start()
            faults = unit.faults()
            check(list(faults) == ["safe_mode"] and "without a word" in faults["safe_mode"]["cause"],
                  "the fourth crash leads to the safe mode, which says why: " + faults["safe_mode"]["cause"])
            check(unit.get("livez")[0] == 200 and unit.get("readyz")[0] == 503, "it lives and is not ready")
            check(unit.hear("WATCHDOG=1") is not None, "and is alive for the service manager")
            unit.end(signal.SIGTERM)
            check(unit.process.returncode == 0, "it stops when it is told to")
        finally:
            if unit.process.poll() is None:
                unit.process.kill()


if __name__ == "__main__":
    main()
