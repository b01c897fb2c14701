"""`pip wheel` from the tree makes a wheel of a built module that works installed, and leaves nothing in the tree.
Without pip and setuptools it is skipped, unless TRIBOTWIN_EVERY_TEST is set. Arguments: build folder, source tree."""
import importlib.util, os, pathlib, subprocess, sys, tempfile, zipfile

build, source = sys.argv[1], pathlib.Path(sys.argv[2])
missing = [name for name in ("pip", "setuptools", "wheel") if not importlib.util.find_spec(name)]
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
        wheel.extractall(pathlib.Path(folder, "site"))
    for name in ("__init__.py", "__init__.pyi", "py.typed"):
        if name not in names:
            sys.exit(f"the wheel has no {name}: {sorted(names)}")
    code = "import tribotwin; print(tribotwin.__file__, tribotwin.Law('extended')(50.0, 0.3, 40.0))"
    env["PYTHONPATH"] = os.path.join(folder, "site")
    r = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, cwd=folder)
    if r.returncode or not r.stdout.startswith(folder):
        sys.exit(f"{r.stdout}\n{r.stderr}")
if sorted(source.joinpath("twin/python").iterdir()) != before:
    sys.exit("the tree has changed")
