"""PNG files of 8 bit without interlacing, as a browser writes them."""
import struct, zlib

import numpy


def pixels(data):
    """(height, width, 3), red, green, blue."""
    at, packed = 8, b""
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at : at + 8])
        content = data[at + 8 : at + 8 + size]
        if kind == b"IHDR":
            width, height, depth, colour, *_, interlaced = struct.unpack(">IIBBBBB", content)
            assert (depth, interlaced) == (8, 0) and colour in (2, 6), content
        elif kind == b"IDAT":
            packed += content
        at += 12 + size
    step = {2: 3, 6: 4}[colour]
    lines = numpy.frombuffer(zlib.decompress(packed), "u1").reshape(height, 1 + width * step)
    made = numpy.zeros((height + 1, step * (width + 1)), "i2")  # with an empty line above and pixel to the left
    for y in range(height):
        filtered, above, row = lines[y, 1:].astype("i2"), made[y], made[y + 1]
        kind = lines[y, 0]
        if kind == 0:
            row[step:] = filtered
        elif kind == 2:
            row[step:] = (filtered + above[step:]) & 255
        else:
            unfilter(kind, filtered.tolist(), above.tolist(), row, step)
    return made[1:, step:].reshape(height, width, step)[:, :, :3]


def unfilter(kind, filtered, above, row, step):
    out = [0] * step
    for i, value in enumerate(filtered):
        a, b, c = out[i], above[i + step], above[i]
        if kind == 1:
            guess = a
        elif kind == 3:
            guess = (a + b) // 2
        else:
            near = a + b - c
            da, db, dc = abs(near - a), abs(near - b), abs(near - c)
            guess = a if da <= db and da <= dc else b if db <= dc else c
        out.append((value + guess) & 255)
    row[:] = out
