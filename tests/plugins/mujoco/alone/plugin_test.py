"""The plugin as another program gets it: what it needs, that it comes with no engine of its own, that it says no to an
engine of another version, and that a program of the C API finds its three plugins."""
import ctypes, os, re, sys

from harness import check, finish, path, run

plugin, engine = sys.argv[1:3]

dynamic = run("readelf", "-dW", plugin).stdout
needed = set(re.findall(r"NEEDED.*\[(.*)\]", dynamic))
soname = os.path.basename(os.path.realpath(engine))
allowed = {soname, "libstdc++.so.6", "libm.so.6", "libgcc_s.so.1", "libc.so.6", "ld-linux-x86-64.so.2"}
check("it needs the engine and the compiler's libraries", soname in needed and needed <= allowed, needed)
check("it has no path to an engine", "RUNPATH" not in dynamic and "RPATH" not in dynamic, dynamic)

# An engine of another version in the same file name: every symbol is there, none may be called but mj_version.
symbols = re.findall(r"U (mj[a-z]?_\w+)", run("nm", "-D", "--undefined-only", plugin).stdout)
with open(path("other.c"), "w") as f:
    f.write("#include <stdlib.h>\n#include <stdio.h>\n")
    for symbol in symbols:
        body = "return 3001004;" if symbol == "mj_version" else f'puts("{symbol} was called"); abort();'
        f.write(f"int {symbol}(void) {{ {body} }}\n")
os.mkdir(path("other"))
run("cc", "-shared", "-fPIC", "-w", f"-Wl,-soname,{soname}", "other.c", "-o", f"other/{soname}")
with open(path("open.py"), "w") as f:
    f.write(f"import ctypes\nctypes.CDLL({plugin!r})\nprint('opened')\n")
environment = {**os.environ, "LD_LIBRARY_PATH": path("other")}
environment.pop("LD_PRELOAD", None)
process = run(sys.executable, "open.py", env=environment)
check(
    "another engine version is refused in words",
    process.stdout == "opened\n"
    and "is built for MuJoCo" in process.stderr
    and "does not serve 3.1.4" in process.stderr,
    (process.returncode, process.stdout, process.stderr),
)
process = run(sys.executable, "open.py", env={**environment, "LD_LIBRARY_PATH": path("nothing")})
check("without an engine the linker names the one it wants", soname in process.stderr, process.stderr)

# Python's wheel, C programs and simulate: the engine is loaded, then the plugin.
mujoco = ctypes.CDLL(engine)
mujoco.mj_loadPluginLibrary(plugin.encode())
mujoco.mjp_getPlugin.restype = ctypes.c_void_p
for name in ("tribotwin.drive", "tribotwin.hysteresis", "tribotwin.sensor"):
    check(f"{name} is registered", mujoco.mjp_getPlugin(name.encode(), None) is not None)

# A second engine in the process: said so.
with open(path("two.py"), "w") as f:
    f.write(
        f"import ctypes\nctypes.CDLL({path('libmujoco.so.9.9')!r})\nctypes.CDLL({engine!r})\nctypes.CDLL({plugin!r})\n"
    )
run("cc", "-shared", "-fPIC", "-w", "-Wl,-soname,libmujoco.so.9.9", "other.c", "-o", "libmujoco.so.9.9")
process = run(sys.executable, "two.py", env=environment | {"LD_LIBRARY_PATH": ""})
check("two engines in a process are named", "2 engines are loaded" in process.stderr, process.stderr)
finish()
