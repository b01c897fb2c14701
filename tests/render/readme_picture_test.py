"""The README's picture is the one that tribotwin-report draws today, up to what another rasteriser or font changes.
Arguments: tribotwin-report, source tree."""
import importlib.util, os, sys

import numpy as np

sys.dont_write_bytecode = True
report, source = sys.argv[1:3]
spec = importlib.util.spec_from_file_location('readme_picture', os.path.join(source, 'render', 'readme_picture.py'))
readme_picture = importlib.util.module_from_spec(spec)
spec.loader.exec_module(readme_picture)
failures = []


def check(name, condition, detail=''):
    print('ok  ' if condition else 'FAIL', name, '' if condition else detail, flush=True)
    if not condition:
        failures.append(name)


def blurred(picture):
    """The mean of every square of 8 x 8 pixels: edges may move by a pixel."""
    rows, columns = (n // 8 for n in picture.shape[:2])
    return picture[: 8 * rows, : 8 * columns].reshape(rows, 8, columns, 8, 3).mean(axis=(1, 3))


def difference(one, other):
    """The share of squares whose colour differs by more than a tenth of the range."""
    if one.shape != other.shape:
        return 1
    return np.mean(np.abs(blurred(one) - blurred(other)).max(axis=2) > 25)


TOLERANCE = 0.003
file = os.path.join(source, 'render', 'readme.png')
with open(file, 'rb') as f:
    committed = readme_picture.read_png(f.read())
drawn = readme_picture.read_png(readme_picture.draw(report))
found = difference(committed, drawn)
check(
    'the picture is up to date',
    found < TOLERANCE,
    f'{found:.4f} of it differ; look at the new one, then: render/readme_picture.py {report}',
)
check('it is small enough for a README', os.path.getsize(file) < 150e3, os.path.getsize(file))

# The tolerance is no excuse: each of these is seen.
readme_picture.ROBOT[-1] = 'joint2=45'
colder = difference(committed, readme_picture.read_png(readme_picture.draw(report)))
check('a colder joint is seen', colder > TOLERANCE, colder)
check('swapped colours are seen', difference(committed, committed[:, :, ::-1]) > TOLERANCE)
check('a mirrored picture is seen', difference(committed, committed[:, ::-1]) > TOLERANCE)

print(f'{len(failures)} failed' if failures else 'all passed')
sys.exit(bool(failures))
