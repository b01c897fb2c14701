"""Which engine -Dmujoco_ROOT takes, and what it says where it takes none. Folders in the layout of a MuJoCo release
are made of the headers and the library of this machine's engine, with other version numbers in the headers."""
import os, re, sys

from harness import check, finish, path, run

source, include, library = sys.argv[1:4]

with open(path("CMakeLists.txt"), "w") as f:
    f.write(
        f"""cmake_minimum_required(VERSION 3.25)
project(engine CXX)
include({source}/plugins/mujoco/engine.cmake)
get_target_property(location mujoco::mujoco LOCATION)
message(STATUS "engine ${{TRIBOTWIN_MUJOCO_NAME}} at ${{location}}")
"""
    )


def release(name, version):
    """A folder like that of an unpacked release, whose header says that version."""
    folder = path(name)
    os.makedirs(folder + "/include/mujoco")
    os.makedirs(folder + "/lib")
    with open(include + "/mujoco/mujoco.h") as f:
        text = re.sub(r"(#define mjVERSION_HEADER) \d+", rf"\1 {version}", f.read())
    with open(folder + "/include/mujoco/mujoco.h", "w") as f:
        f.write(text)
    os.symlink(library, folder + "/lib/libmujoco.so")
    return folder


def wheel(name, version):
    """The same as Python's package has it: the library beside include/, under its full name."""
    folder = release(name, version)
    os.rename(folder + "/lib/libmujoco.so", folder + "/libmujoco.so.3.3.7")
    os.rmdir(folder + "/lib")
    return folder


def configure(build, *options, **environment):
    process = run("cmake", "-S", path(), "-B", path(build), *options, env={**os.environ, **environment})
    # CMake breaks the lines of its messages.
    return process.returncode, " ".join((process.stdout + process.stderr).split())


def takes(name, build, *options, says, **environment):
    code, output = configure(build, *options, **environment)
    check(name, code == 0 and says in output, output)


def refuses(name, build, *options, says, **environment):
    code, output = configure(build, *options, **environment)
    check(name, code != 0 and all(s in output for s in says), output)


new = release("mujoco-3.12.0", 3012000)
takes("a release is taken", "a", f"-Dmujoco_ROOT={new}", says=f"engine 3.12 at {new}/lib/libmujoco.so")
takes("the environment names one, too", "b", says=f"engine 3.12 at {new}/lib", mujoco_ROOT=new)
patch = release("mujoco-3.3.7", 337)
takes("another one in the same build folder", "a", f"-Dmujoco_ROOT={patch}", says=f"engine 3.3.7 at {patch}/lib")
takes("a patch of a newer one", "c", f"-Dmujoco_ROOT={release('p', 3012001)}", says="engine 3.12.1 at")

python = wheel("mujoco", 337)
takes("Python's package", "i", f"-Dmujoco_ROOT={python}", says=f"engine 3.3.7 at {python}/libmujoco.so.3.3.7")

os.mkdir(path("empty"))
refuses(
    "a folder without an engine",
    "d",
    f"-Dmujoco_ROOT={path('empty')}",
    says=[f"mujoco_ROOT is {path('empty')}, which holds neither", "unpacked MuJoCo release"],
)
refuses("a folder that does not exist", "e", "-Dmujoco_ROOT=/nonexistent/mujoco", says=["/nonexistent/mujoco, which"])
refuses("4.0.0", "f", f"-Dmujoco_ROOT={release('mujoco-4.0.0', 4000000)}", says=["4.0.0 can factor", "use 4.0.1"])
takes("4.0.1", "g", f"-Dmujoco_ROOT={release('mujoco-4.0.1', 4000001)}", says="engine 4.0.1 at")

old = release("mujoco-2.3.0", 230)
process = run("cmake", "-S", source, "-B", path("h"), "-DTRIBOTWIN_PLUGIN_ONLY=ON", f"-Dmujoco_ROOT={old}")
check(
    "the plugin alone with an engine without plugins",
    process.returncode != 0 and "MuJoCo 2.3 has no plugins of this kind" in " ".join(process.stderr.split()),
    process.stderr,
)
finish()
