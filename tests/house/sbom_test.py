"""The list of packages in the programs (twin/sbom.py): what the linker says is in it, with the versions of dpkg; so is
what is compiled in. Arguments: the sources, a build folder."""
import json, os, re, subprocess, sys

from harness import check, finish

source, build = sys.argv[1:]
made = subprocess.run(
    ["/usr/bin/python3", f"{source}/twin/sbom.py", build], capture_output=True, text=True, timeout=300
)
check("it is made", made.returncode == 0, made.stderr)
document = json.loads(made.stdout or "{}")
found = {c["name"]: c for c in document.get("components", [])}
check("it is CycloneDX 1.5", (document.get("bomFormat"), document.get("specVersion")) == ("CycloneDX", "1.5"))
needed = re.findall(
    r"NEEDED.*\[(.*)\]", subprocess.check_output(["readelf", "-d", f"{build}/bin/tribotwin"], text=True)
)
owners = subprocess.check_output(["dpkg-query", "-S", *needed], text=True)
for library in needed:
    packages = set(re.findall(rf"^([^:]+):.*/{re.escape(library)}$", owners, re.M))
    check(f"{library} is in it", packages & set(found), packages)
check("libosmesa6, which is loaded while it runs, is in it", "libosmesa6" in found)
for name in ("libjs-three", "libeigen3-dev", "nlohmann-json3-dev"):
    check(f"{name}, which is compiled in, is in it", name in found)
versions = subprocess.check_output(["dpkg-query", "-W", "-f", "${Package}\t${Version}\n"], text=True)
installed = {tuple(line.split("\t")) for line in versions.splitlines()}
other = [c["name"] for c in found.values() if (c["name"], c["version"]) not in installed]
check("every package has the version that is installed", found and not other, other)
wrong = subprocess.run(
    ["/usr/bin/python3", f"{source}/twin/sbom.py", os.path.dirname(build)], capture_output=True, text=True
)
check("another folder is refused", wrong.returncode == 1 and "holds no bin/tribotwin" in wrong.stderr, wrong.stderr)
finish()
