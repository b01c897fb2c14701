"""`pip wheel` from the tree makes a wheel of a built module, which imports in a fresh venv where pip has installed it
without an index; the tree stays as it is. NumPy is the system's. Without pip, setuptools, venv it is skipped, unless
TRIBOTWIN_EVERY_TEST is set. Arguments: build folder, source tree."""
import importlib.util, os, pathlib, subprocess, sys, tempfile, zipfile

build, source = sys.argv[1], pathlib.Path(sys.argv[2])
missing = [name for name in ("pip", "setuptools", "wheel", "venv") if not importlib.util.find_spec(name)]
if missing:
    print("SKIPPED, missing:", *missing)
    sys.exit(1 if os.environ.get("TRIBOTWIN_EVERY_TEST") else 77)

before = sorted(source.joinpath("twin/python").iterdir())
pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--no-cache-dir"]
with tempfile.TemporaryDirectory() as folder:
    command = [*pip, "wheel", "--no-build-isolation", "--no-deps", "--no-index", "-w", folder, source / "twin/python"]
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    r = subprocess.run(command, env={**env, "TRIBOTWIN_BUILD": build}, capture_output=True, text=True)
    wheels = list(pathlib.Path(folder).glob("tribotwin-*.whl"))
    if r.returncode or len(wheels) != 1:
        sys.exit(f"{r.stdout}\n{r.stderr}")
    with zipfile.ZipFile(wheels[0]) as wheel:
        names = {pathlib.PurePath(name).name for name in wheel.namelist()}
    for name in ("__init__.py", "__init__.pyi", "py.typed"):
        if name not in names:
            sys.exit(f"the wheel has no {name}: {sorted(names)}")
    code = "import tribotwin; print(tribotwin.__file__, tribotwin.Law('extended')(50.0, 0.3, 40.0))"
    venv = os.path.join(folder, "venv")
    python = os.path.join(venv, "bin", "python")
    for command in (
        [sys.executable, "-m", "venv", "--without-pip", "--system-site-packages", venv],
        [*pip, "--python", python, "install", "--no-index", "--no-deps", "--ignore-installed", wheels[0]],
        [python, "-c", code],
    ):
        r = subprocess.run(command, env=env, capture_output=True, text=True, cwd=folder)
        if r.returncode:
            sys.exit(f"{command}\n{r.stdout}\n{r.stderr}")
    if not r.stdout.startswith(os.path.realpath(venv)):
        sys.exit(f"not imported from the venv: {r.stdout}")
if sorted(source.joinpath("twin/python").iterdir()) != before:
    sys.exit("the tree has changed")
