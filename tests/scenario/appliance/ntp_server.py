"""An NTP server on loopback that tells this computer's time; port 123 is root's."""

import socket
import struct
import threading
import time

SECONDS_1900_TO_1970 = 2208988800


def ntp_time(unix_s):
    seconds = int(unix_s)
    return seconds + SECONDS_1900_TO_1970, int((unix_s - seconds) * (1 << 32))


class NtpServer:
    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 123))
        self.asked = 0

    def __enter__(self):
        threading.Thread(target=self.answer, daemon=True).start()
        return self

    def __exit__(self, *_):
        self.socket.close()

    def answer(self):
        while True:
            try:
                question, sender = self.socket.recvfrom(1024)
            except OSError:
                return
            if len(question) < 48:
                continue
            self.asked += 1
            now = ntp_time(time.time())
            # Leap 0, version 4, server; stratum 1; poll and precision; then delay, dispersion, who, and four times.
            head = struct.pack(">BBbb", 0x24, 1, 6, -20) + struct.pack(">II4s", 0, 0x100, b"TEST")
            self.socket.sendto(head + struct.pack(">II", *now) + question[40:48] + struct.pack(">IIII", *now, *now), sender)
