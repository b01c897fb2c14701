"""python-can's socketcand interface, unchanged, against our server. Argument: the echo_server program."""
import logging, random, re, socket, subprocess, sys, threading, time

import can

from harness import check, finish

logging.getLogger("can").setLevel(logging.ERROR)  # it warns of every read that ends inside a frame


def serve(frames):
    server = subprocess.Popen(
        [sys.argv[1], "socketcand://127.0.0.1:0/can0", str(frames)], stdout=subprocess.PIPE, text=True
    )
    return server, int(re.search(r"127\.0\.0\.1:(\d+)", server.stdout.readline()).group(1))


def connect(port, channel="can0"):
    return can.interface.Bus(interface="socketcand", host="127.0.0.1", port=port, channel=channel)


def same(sent, got):
    return got is not None and got.arbitration_id == sent.arbitration_id + 1 and bytes(got.data) == bytes(sent.data)


# One frame after the other: every length, standard and extended identifiers, old and new time.
cases = [
    can.Message(arbitration_id=i, is_extended_id=e, data=bytes(range(n)))
    for n in range(9)
    for i, e in ((0, False), (0x601, False), (0x7FE, False), (0x800, True), (0x12345, True), (0x1FFFFFFE, True))
]
server, port = serve(len(cases))
bus = connect(port)
round_trips = []
for sent in cases:
    start = time.perf_counter()
    bus.send(sent)
    got = bus.recv(10)
    round_trips.append(time.perf_counter() - start)
    check(f"answer to {sent.arbitration_id:X} with {sent.dlc} bytes", same(sent, got), got)
    check("its time is now", got is not None and abs(got.timestamp - time.time()) < 60, got)
bus.shutdown()
check("server ends by itself", server.wait(30) == 0, server.returncode)
round_trips.sort()
print(f"round trip: median {1e6 * round_trips[len(round_trips) // 2]:.0f} us, longest {1e6 * round_trips[-1]:.0f} us")

# A burst: python-can reads 1024 bytes at a time, so most reads end inside a frame.
random.seed(1)
burst = [
    can.Message(
        arbitration_id=random.randrange(0x7FF), is_extended_id=False, data=random.randbytes(random.randrange(9))
    )
    for _ in range(3000)
]
server, port = serve(len(burst))
bus = connect(port)
for sent in burst:
    bus.send(sent)
wrong = next((i for i, sent in enumerate(burst) if not same(sent, bus.recv(10))), None)
check("3000 frames in a burst, none lost, in order", wrong is None, f"frame {wrong} is lost or differs")
bus.shutdown()
check("server ends by itself after the burst", server.wait(30) == 0, server.returncode)

# Connecting to a busy bus: the frames of the others must not get in the way of the handshake.
server, port = serve(1_000_000)
busy = connect(port)
done = threading.Event()


def keep_busy():
    while not done.is_set():
        busy.send(burst[0])
        busy.recv(1)


talker = threading.Thread(target=keep_busy)
talker.start()
for attempt in range(20):
    try:
        second = connect(port)
        check(f"connected to a busy bus, attempt {attempt}", all(second.recv(10) is not None for _ in range(20)))
        second.shutdown()
    except can.CanError as error:
        check(f"connected to a busy bus, attempt {attempt}", False, error)
done.set()
talker.join()

try:
    connect(port, "can7").shutdown()
    check("a bus of another name is refused", False)
except can.CanError:
    check("a bus of another name is refused", True)
busy.shutdown()
server.kill()
server.wait()

# Sixteen connections that say nothing lock nobody out; sixteen clients are enough.
server, port = serve(1_000_000)
idle = [socket.create_connection(("127.0.0.1", port)) for _ in range(16)]
clients = []
for k in range(16):
    try:
        clients.append(connect(port))
    except can.CanError as error:
        check(f"client {k} beside idle connections", False, error)
        break
check("sixteen clients beside sixteen idle connections", len(clients) == 16)
for k, client in enumerate(clients):  # each hears what the others say, too
    own = can.Message(arbitration_id=0x100 + 2 * k, is_extended_id=False)
    client.send(own)
    check(f"client {k} is answered", any(same(own, client.recv(10)) for _ in range(32)))
try:
    connect(port).shutdown()
    check("the seventeenth is refused", False)
except can.CanError:
    check("the seventeenth is refused", True)
clients.pop().shutdown()
time.sleep(0.2)
connect(port).shutdown()
check("and has the place of one that left", True)
server.kill()
server.wait()
finish()
