"""WebSocket frames (RFC 6455) without extensions, for both ends of a connection."""
import base64, hashlib, os, socket, struct, threading

TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10


class Socket:
    """One end. `masks`: a client must mask what it sends."""

    def __init__(self, connection, masks):
        self.connection, self.masks = connection, masks
        self.file = connection.makefile("rb")
        self.lock = threading.Lock()

    def send(self, payload, kind=None):
        kind = kind or (TEXT if isinstance(payload, str) else BINARY)
        data = payload.encode() if isinstance(payload, str) else payload
        mask = 0x80 if self.masks else 0
        head = bytes([0x80 | kind])
        if len(data) < 126:
            head += bytes([mask | len(data)])
        elif len(data) < 1 << 16:
            head += struct.pack(">BH", mask | 126, len(data))
        else:
            head += struct.pack(">BQ", mask | 127, len(data))
        if mask:
            key = os.urandom(4)
            head += key
            data = bytes(b ^ key[i % 4] for i, b in enumerate(data))
        with self.lock:
            self.connection.sendall(head + data)

    def read(self, n):
        data = self.file.read(n)
        if len(data) < n:
            raise ConnectionError("closed")
        return data

    def receive(self):
        """(kind, payload) of the next whole message; pings are answered; ConnectionError at the end."""
        kind, whole = None, b""
        while True:
            first, second = self.read(2)
            length = second & 0x7F
            if length >= 126:
                length = struct.unpack(">H" if length == 126 else ">Q", self.read(2 if length == 126 else 8))[0]
            key = self.read(4) if second & 0x80 else None
            data = self.read(length)
            if key:
                data = bytes(b ^ key[i % 4] for i, b in enumerate(data))
            if first & 0x0F == CLOSE:
                raise ConnectionError("closed")
            if first & 0x0F == PING:
                self.send(data, PONG)
            elif first & 0x0F != PONG:
                kind, whole = kind or first & 0x0F, whole + data
                if first & 0x80:
                    return kind, whole

    def close(self):
        try:
            self.connection.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self.connection.close()


def accept_key(key):
    return base64.b64encode(hashlib.sha1((key + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11").encode()).digest()).decode()


def connect(host, port, path):
    connection = socket.create_connection((host, port), 20)
    connection.settimeout(60)
    request = f"GET {path} HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    request += "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    connection.sendall(request.encode())
    made = Socket(connection, masks=True)
    status = made.file.readline()
    while made.file.readline().strip():
        pass
    if b" 101 " not in status:
        raise ConnectionError(status)
    return made
