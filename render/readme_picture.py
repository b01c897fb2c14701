#!/usr/bin/python3
"""Draws the picture of the project's README: a warm robot beside the friction of one of its joints, by
tribotwin-report.
Usage: render/readme_picture.py build/release/bin/tribotwin-report [PICTURE.png]   (default: render/readme.png)"""
import pathlib
import struct
import subprocess
import sys
import tempfile
import zlib

import numpy as np

SOURCE = pathlib.Path(__file__).resolve().parent.parent
MODEL = SOURCE / 'mjcf' / 'irb6620.xml'
JOINT_DEGC = {'joint1': 48, 'joint2': 78, 'joint3': 68, 'joint4': 56, 'joint5': 61, 'joint6': 42}
ROBOT = [
    *('pose', MODEL, '--size', '800x720', '--text-scale', '1.7', '--pose', 'joint2=0.35', '--pose', 'joint3=-0.1'),
    *('--azimuth', '122', '--elevation', '-22', '--distance', '4.7', '--look-at', '0.57', '-0.04', '0.92'),
]
for joint, degC in JOINT_DEGC.items():
    ROBOT += ['--joint-temperature', f'{joint}={degC}']
FRICTION = ['curve', MODEL, '--joint', 'joint2', '--size', '440x360']
COLOURS = 256


def read_png(data):
    """Rows of pixels of a PNG file with 8-bit RGB or palette, without interlace."""
    at, body, palette = 8, b'', None
    while at < len(data):
        length, kind = struct.unpack('>I4s', data[at : at + 8])
        chunk = data[at + 8 : at + 8 + length]
        if kind == b'IHDR':
            width, height, depth, colour = struct.unpack('>IIBB', chunk[:10])
        elif kind == b'PLTE':
            palette = np.frombuffer(chunk, np.uint8).reshape(-1, 3)
        elif kind == b'IDAT':
            body += chunk
        at += 12 + length
    if depth != 8 or colour not in (2, 3):
        raise ValueError(f'PNG of {depth} bits and colour type {colour}: must be 8 bits, RGB or palette')
    step = 3 if colour == 2 else 1
    lines = np.frombuffer(zlib.decompress(body), np.uint8).reshape(height, 1 + width * step)
    pixels = np.zeros((height + 1, width + 1, step), np.uint8)  # with a black line above and a black pixel before each
    for y, line in enumerate(lines, 1):
        row, above = pixels[y], pixels[y - 1]
        values = line[1:].reshape(width, step)
        if line[0] == 0:
            row[1:] = values
        elif line[0] == 1:
            row[1:] = np.cumsum(values, axis=0, dtype=np.uint8)
        elif line[0] == 2:
            row[1:] = values + above[1:]
        else:
            unfilter(row, above, values, average=line[0] == 3)
    picture = pixels[1:, 1:]
    return palette[picture[:, :, 0]] if palette is not None else picture


def unfilter(row, above, values, average):
    """A line with PNG's filter Average or Paeth."""
    for channel in range(values.shape[1]):
        up, given, left, corner, out = above[1:, channel].tolist(), values[:, channel].tolist(), 0, 0, []
        for b, value in zip(up, given):
            if average:
                guess = (left + b) // 2
            else:
                a_far, b_far, c_far = abs(b - corner), abs(left - corner), abs(left + b - 2 * corner)
                guess = left if a_far <= b_far and a_far <= c_far else b if b_far <= c_far else corner
            left, corner = (value + guess) & 255, b
            out.append(left)
        row[1:, channel] = out


def chunk(kind, data):
    return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))


def write_png(indices, palette):
    height, width = indices.shape
    lines = np.zeros((height, width + 1), np.uint8)
    lines[:, 1:] = indices
    return (
        b'\x89PNG\r\n\x1a\n'
        + chunk(b'IHDR', struct.pack('>IIBBBBB', width, height, 8, 3, 0, 0, 0))
        + chunk(b'PLTE', palette.astype(np.uint8).tobytes())
        + chunk(b'IDAT', zlib.compress(lines.tobytes(), 9))
        + chunk(b'IEND', b'')
    )


def reduce_colours(picture):
    """The picture as indices of a palette: median cut, then each colour's mean (k-means)."""
    colours, inverse, counts = np.unique(picture.reshape(-1, 3), axis=0, return_inverse=True, return_counts=True)
    values = colours.astype(float)
    boxes = [np.arange(len(colours))]
    while len(boxes) < COLOURS:
        spread = [np.ptp(values[b], axis=0).max() * np.sqrt(counts[b].sum()) if len(b) > 1 else 0 for b in boxes]
        widest = int(np.argmax(spread))
        if spread[widest] == 0:
            break
        box = boxes.pop(widest)
        box = box[np.argsort(values[box, np.ptp(values[box], axis=0).argmax()], kind='stable')]
        half = np.searchsorted(np.cumsum(counts[box]), counts[box].sum() / 2)
        half = min(max(int(half), 1), len(box) - 1)
        boxes += [box[:half], box[half:]]
    palette = np.array([np.average(values[b], axis=0, weights=counts[b]) for b in boxes])
    for _ in range(4):
        nearest = ((values**2).sum(1)[:, None] - 2 * values @ palette.T + (palette**2).sum(1)).argmin(1)
        weight = np.bincount(nearest, counts, len(palette))
        for c in range(3):
            total = np.bincount(nearest, counts * values[:, c], len(palette))
            palette[:, c] = np.where(weight > 0, total / np.maximum(weight, 1), palette[:, c])
    return nearest[inverse.reshape(-1)].reshape(picture.shape[:2]), palette.round()


def draw(report):
    """Both pictures beside each other, as the bytes of a PNG file."""
    parts = []
    with tempfile.TemporaryDirectory() as folder:
        for command in (ROBOT, FRICTION):
            file = pathlib.Path(folder) / f'{command[0]}.png'
            subprocess.run([report, *map(str, command), '-o', file], check=True, stdout=subprocess.DEVNULL)
            parts.append(read_png(file.read_bytes()))
    height = max(len(part) for part in parts)
    parts = [np.pad(part, ((0, height - len(part)), (0, 0), (0, 0)), constant_values=255) for part in parts]
    return write_png(*reduce_colours(np.hstack(parts)))


if __name__ == '__main__':
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    output = pathlib.Path(sys.argv[2]) if len(sys.argv) == 3 else SOURCE / 'render' / 'readme.png'
    output.write_bytes(draw(sys.argv[1]))
    print(output)
