"""Nothing but the named interface is heard by a robot.

Usage: outside.py STRIDEMAP_BINARY DOMAIN; uses two domains. As root the robot stands in a network namespace of its
own, with a second one beside it; where there are none, other addresses of this machine must do. Exits with 1 if a
robot on loopback hears a datagram from another address, or a robot on another interface is not heard there.

The datagram is one that the robot would obey: an emergency stop, taken from the wire, with the next sequence number.
"""

import atexit
import json
import os
import socket
import struct
import subprocess
import sys
import threading
import time
from dataclasses import dataclass

NEAR, FAR = "10.123.0.1", "10.123.0.2"


def robot(binary, domain, *more):
    """A robot that stands, and where its sockets listen."""
    process = subprocess.Popen([binary, "robot", "op3", "--domain", str(domain), "--seconds", "120", *more],
                               stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    atexit.register(process.kill)
    line = process.stderr.readline()
    assert "stands" in line, line
    shown = subprocess.check_output(["ss", "-lunpH"], text=True)
    local = [row.split()[3] for row in shown.splitlines() if f"pid={process.pid}," in row]
    assert len(local) >= 4, shown
    return process, local


def port(address):
    return int(address.rsplit(":", 1)[1])


def send(payload, source, target):
    """Sends a datagram; whether the machine said that nobody is there to hear it."""
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    udp.bind((source, 0))
    udp.connect(target)
    udp.settimeout(0.3)
    udp.send(payload)
    try:
        udp.recv(1)
    except ConnectionRefusedError:
        return True
    except TimeoutError:
        return False


class Wire:
    """What passes on loopback and holds a word: destination port and payload. Needs to be root."""

    def __init__(self, word):
        self.word, self.seen = word, []
        self.raw = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(3))
        self.raw.bind(("lo", 0))
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        while True:
            frame = self.raw.recv(65535)
            if self.word in frame and frame[12:14] == b"\x08\x00":
                udp = 14 + (frame[14] & 15) * 4
                self.seen.append((struct.unpack(">H", frame[udp + 2:udp + 4])[0], frame[udp + 8:]))

    def next(self, word):
        """The first that was seen, with another word and the next sequence number in its DATA submessage."""
        to, payload = self.seen[0]
        rtps, at = bytearray(payload.replace(self.word, word)), 20
        while at < len(rtps):
            kind, _, length = struct.unpack("<BBH", rtps[at:at + 4])
            if kind == 0x15:
                (low,) = struct.unpack("<I", rtps[at + 20:at + 24])
                rtps[at + 20:at + 24] = struct.pack("<I", low + 1)
            at += 4 + length if length else len(rtps)
        return to, bytes(rtps)


class Client:
    """The robot's emergency stop, by Cyclone DDS on loopback."""

    def __init__(self, domain):
        from cyclonedds.core import Policy, Qos
        from cyclonedds.domain import DomainParticipant
        from cyclonedds.idl import IdlStruct
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic
        from cyclonedds.util import duration

        @dataclass
        class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
            data: str

        reliable = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.Durability.Volatile,
                       Policy.History.KeepLast(8))
        here = DomainParticipant(domain)
        topic = lambda name: Topic(here, f"rt/stridemap/{name}", String, qos=reliable)
        writer = lambda name: DataWriter(here, topic(name), qos=reliable)
        stop, rearm = writer("stop"), writer("rearm")
        self.press = lambda word: stop.write(String(word))
        self.release = lambda: rearm.write(String(""))
        self.status = DataReader(here, topic("status"), qos=reliable)

    def stopped(self, wanted=None, seconds=1.0):
        """Why the robot says that it is stopped; waits longer for what is wanted."""
        last, began = None, time.time()
        while time.time() < began + (10 if wanted is not None else seconds):
            for sample in self.status.take(64):
                last = json.loads(sample.data)["stopped"] or ""
            if last is not None and last == wanted:
                break
            time.sleep(0.02)
        return last


def loopback(binary, domain, other, far):
    """A robot on its defaults hears 127.0.0.1 and nobody else."""
    process, local = robot(binary, domain)
    assert all("%lo:" in a or a.startswith("127.") for a in local), f"not on loopback alone: {local}"
    heard = [a for a in local if not send(b"?", other, (other, port(a)))]
    assert not heard, f"hears datagrams to {other}: {heard}"
    if os.geteuid() == 0:
        wire, client = Wire(b"WORD-A"), Client(domain)
        time.sleep(2)
        client.press("WORD-A")
        assert client.stopped("WORD-A") == "WORD-A", "does not hear loopback"
        client.release()
        assert client.stopped("") == ""
        to, forged = wire.next(b"WORD-B")
        for source, target in [(other, other), (other, "127.0.0.1")]:
            send(forged, source, (target, to))
            assert client.stopped() == "", f"obeys {source}, which sent to {target}"
        if far:
            program = f"import outside; outside.send(bytes.fromhex('{forged.hex()}'), '{FAR}', ('{NEAR}', {to}))"
            subprocess.run(far + [sys.executable, "-c", program], check=True, cwd=os.path.dirname(__file__) or ".")
            assert client.stopped() == "", "obeys another machine"
        # The same from 127.0.0.1: the datagram is as good as one of the client's own.
        send(forged, "127.0.0.1", ("127.0.0.1", to))
        assert client.stopped("WORD-B") == "WORD-B", "the forged datagram says nothing: this test is void"
    process.kill()


def named(binary, domain, far):
    """A robot on another interface is heard there, from this machine and from the next, and not on loopback."""
    process, local = robot(binary, domain, "--interface", NEAR)
    assert all("%near:" in a or a.startswith(NEAR) for a in local), local
    heard = [a for a in local if not send(b"?", "127.0.0.1", ("127.0.0.1", port(a)))]
    assert not heard, f"hears loopback: {heard}"
    stop = [binary, "stop", "--domain", str(domain), "--interface"]
    subprocess.run(far + stop + [FAR], check=True, stdout=subprocess.DEVNULL)
    subprocess.run(stop + [NEAR, "--rearm"], check=True, stdout=subprocess.DEVNULL)
    process.kill()


def inside(binary, domain, far):
    os.environ["CYCLONEDDS_URI"] = (
        '<CycloneDDS><Domain><General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>'
        "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
        '<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>')
    if far:
        loopback(binary, domain, NEAR, far)
        named(binary, domain + 1, far)
        return
    own = subprocess.run(["hostname", "-I"], capture_output=True, text=True).stdout.split()
    other = next((a for a in own if "." in a), None)
    if other is None:
        print("outside: skipped: no network namespaces, and no address but loopback's")
    else:
        print(f"outside: no network namespaces; by this machine's {other}")
        loopback(binary, domain, other, None)


def main():
    if sys.argv[1] == "--inside":
        return inside(sys.argv[2], int(sys.argv[3]), ["ip", "netns", "exec", sys.argv[4]])
    binary, domain = os.path.abspath(sys.argv[1]), sys.argv[2]
    near, far = (f"stridemap-{end}-{os.getpid()}" for end in ("near", "far"))
    ip = lambda words: subprocess.run(["ip", *words.split()], stderr=subprocess.DEVNULL).returncode == 0
    made = [name for name in (near, far) if ip(f"netns add {name}")]
    try:
        wired = len(made) == 2 and ip(f"link add near netns {near} type veth peer name far netns {far}") and all(
            ip(f"-n {name} addr add {address}/24 dev {end}") and ip(f"-n {name} link set {end} up")
            and ip(f"-n {name} link set lo up")
            for name, end, address in ((near, "near", NEAR), (far, "far", FAR)))
        if wired:
            words = [sys.executable, __file__, "--inside", binary, domain, far]
            subprocess.run(["ip", "netns", "exec", near, *words], check=True)
        else:
            inside(binary, int(domain), None)
    finally:
        for name in made:
            ip(f"netns del {name}")
    print("outside: nothing but the named interface is heard")


if __name__ == "__main__":
    main()
