"""A reader of MCAP files in Python tests, written after the specification and not with our own code."""
import ctypes, zlib

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(11, 16)

zstd = ctypes.CDLL("libzstd.so.1")
zstd.ZSTD_decompress.restype = ctypes.c_size_t
zstd.ZSTD_decompress.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_char_p, ctypes.c_size_t]


def decompress(data, size):
    out = ctypes.create_string_buffer(size)
    made = zstd.ZSTD_decompress(out, size, data, len(data))
    assert made == size, (made, size)
    return out.raw


class Fields:
    """Takes the content of a record apart, from its beginning."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def number(self, bits):
        self.at += bits // 8
        return int.from_bytes(self.data[self.at - bits // 8 : self.at], "little")

    def bytes(self, size):
        self.at += size
        assert self.at <= len(self.data)
        return self.data[self.at - size : self.at]

    def text(self):
        return self.bytes(self.number(32)).decode()

    def pairs(self, *kinds):
        inner = Fields(self.bytes(self.number(32)))
        out = []
        while inner.at < len(inner.data):
            out.append(tuple(inner.text() if k == "text" else inner.number(k) for k in kinds))
        return out

    def rest(self):
        return self.data[self.at :]


def records(data, begin=0):
    """(place, code, content) of each."""
    while begin < len(data):
        size = int.from_bytes(data[begin + 1 : begin + 9], "little")
        assert begin + 9 + size <= len(data), "a record is cut"
        yield begin, data[begin], data[begin + 9 : begin + 9 + size]
        begin += 9 + size


class Mcap:
    """A whole file; whatever is wrong with it is an AssertionError."""

    def __init__(self, file):
        self.data = data = open(file, "rb").read()
        assert data.startswith(MAGIC) and data.endswith(MAGIC)
        self.schemas, self.channels, self.messages, self.chunks, self.metadata = {}, {}, {}, {}, {}
        end = len(data) - len(MAGIC)
        footer = Fields(data[end - 20 : end])
        assert data[end - 29] == FOOTER
        self.summary, self.offsets, crc = footer.number(64), footer.number(64), footer.number(32)
        assert crc == zlib.crc32(data[self.summary : end - 4]), "the checksum of the summary"
        self.read_data()
        self.read_summary(end - 29)

    def read_data(self):
        chunk = None
        for place, code, content in records(self.data[: self.summary], len(MAGIC)):
            fields = Fields(content)
            if code == HEADER:
                self.profile, self.library = fields.text(), fields.text()
            elif code in (SCHEMA, CHANNEL):
                self.declare(code, fields)
            elif code == METADATA:
                self.metadata[place] = (9 + len(content), fields.text(), dict(fields.pairs("text", "text")))
            elif code == CHUNK:
                chunk = self.chunks[place] = self.read_chunk(9 + len(content), fields)
            elif code == MESSAGE_INDEX:
                channel = fields.number(16)
                chunk["indexes"][channel] = (place, fields.pairs(64, 64))
                chunk["index_bytes"] += 9 + len(content)
            elif code == DATA_END:
                assert fields.number(32) == zlib.crc32(self.data[:place]), "the checksum of the data"
                last = place + 9 + len(content)
        assert last == self.summary, "the summary follows the data"

    def declare(self, code, fields):
        number = fields.number(16)
        if code == SCHEMA:
            one = (fields.text(), fields.text(), fields.text())
        else:
            one = (fields.number(16), fields.text(), fields.text(), dict(fields.pairs("text", "text")))
        known = (self.schemas if code == SCHEMA else self.channels).setdefault(number, one)
        assert known == one, "a repeated declaration is another"

    def read_chunk(self, size, fields):
        first, last, whole, crc = (fields.number(n) for n in (64, 64, 64, 32))
        kind = fields.text()
        packed = fields.bytes(fields.number(64))
        assert kind == "zstd" and not fields.rest()
        inside = decompress(packed, whole)
        assert zlib.crc32(inside) == crc, "the checksum of a chunk"
        chunk = {"size": size, "kind": kind, "packed": len(packed), "whole": whole, "times": (first, last)}
        chunk.update(indexes={}, index_bytes=0, found={})
        for place, code, content in records(inside):
            assert code == MESSAGE
            message = Fields(content)
            channel, sequence, logged, published = (message.number(n) for n in (16, 32, 64, 64))
            assert logged == published and first <= logged <= last
            of_channel = self.messages.setdefault(channel, [])
            assert sequence == len(of_channel), "messages are counted"
            of_channel.append((logged, message.rest()))
            chunk["found"].setdefault(channel, []).append((logged, place))
        return chunk

    def read_summary(self, end):
        groups = {}
        for place, code, content in records(self.data[:end], self.summary):
            fields = Fields(content)
            if code == SUMMARY_OFFSET:
                assert place >= self.offsets
                group, begin, size = fields.number(8), fields.number(64), fields.number(64)
                assert groups[group] == [begin, begin + size], "a summary offset"
                continue
            groups.setdefault(code, [place, 0])[1] = place + 9 + len(content)
            if code in (SCHEMA, CHANNEL):
                self.declare(code, fields)
            elif code == CHUNK_INDEX:
                self.check_chunk_index(fields)
            elif code == METADATA_INDEX:
                at, size, name = fields.number(64), fields.number(64), fields.text()
                assert self.metadata[at][:2] == (size, name), "a metadata index"
            elif code == STATISTICS:
                self.check_statistics(fields)
        assert {SCHEMA, CHANNEL, CHUNK_INDEX, STATISTICS, METADATA_INDEX} <= set(groups), groups

    def check_chunk_index(self, fields):
        times, place, size = (fields.number(64), fields.number(64)), fields.number(64), fields.number(64)
        chunk = self.chunks[place]
        assert (times, size) == (chunk["times"], chunk["size"])
        assert dict(fields.pairs(16, 64)) == {c: p for c, (p, _) in chunk["indexes"].items()}
        assert fields.number(64) == chunk["index_bytes"] and fields.text() == chunk["kind"]
        assert (fields.number(64), fields.number(64)) == (chunk["packed"], chunk["whole"])
        assert {c: e for c, (_, e) in chunk["indexes"].items()} == chunk["found"], "an index of messages"

    def check_statistics(self, fields):
        counts = {c: len(m) for c, m in self.messages.items()}
        expected = (
            sum(counts.values()),
            len(self.schemas),
            len(self.channels),
            0,
            len(self.metadata),
            len(self.chunks),
        )
        assert tuple(fields.number(n) for n in (64, 16, 32, 32, 32, 32)) == expected
        times = [t for m in self.messages.values() for t, _ in m]
        assert (fields.number(64), fields.number(64)) == (min(times), max(times))
        assert dict(fields.pairs(16, 64)) == counts
