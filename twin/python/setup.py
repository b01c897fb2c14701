"""Builds the module with CMake, for the Python that runs this. TRIBOTWIN_BUILD=FOLDER takes the module of an existing
build instead."""

import atexit
import os
import pathlib
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

here = pathlib.Path(__file__).resolve().parent
root = here.parents[1]
version = re.search(r'project\(tribotwin VERSION ([\d.]+)', (root / 'CMakeLists.txt').read_text())[1]
suffix = sysconfig.get_config_var('EXT_SUFFIX')


class BuildByCMake(build_ext):
    def build_extension(self, extension):
        given = os.environ.get('TRIBOTWIN_BUILD')
        build = pathlib.Path(given) if given else pathlib.Path(self.build_temp).resolve() / 'cmake'
        if not given:
            options = ['-DCMAKE_BUILD_TYPE=Release', '-DTRIBOTWIN_UNITY_BUILD=ON', '-DTRIBOTWIN_BUILD_TESTS=OFF']
            options += ['-DTRIBOTWIN_BUILD_REPORTS=OFF', f'-DPython_EXECUTABLE={sys.executable}']
            subprocess.run(['cmake', '-S', root, '-B', build, '-G', 'Ninja', *options], check=True)
            subprocess.run(['cmake', '--build', build, '--target', 'tribotwin_python'], check=True)
        module = build / 'python' / 'tribotwin' / f'_tribotwin{suffix}'
        if not module.is_file():
            sys.exit(
                f'{module}: is not there; pybind11-dev or python3-dev is missing, or the build is for another Python'
            )
        target = pathlib.Path(self.get_ext_fullpath(extension.name))
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(module, target)


elsewhere = tempfile.mkdtemp(prefix='tribotwin_wheel_')  # the tree stays as it is
atexit.register(shutil.rmtree, elsewhere, True)
setup(
    version=version,
    ext_modules=[Extension('tribotwin._tribotwin', sources=[])],
    cmdclass={'build_ext': BuildByCMake},
    options={'build': {'build_base': elsewhere}, 'egg_info': {'egg_base': elsewhere}},
)
