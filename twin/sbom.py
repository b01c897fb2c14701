"""The Debian packages that are part of the programs of a build folder, as a CycloneDX 1.5 document on stdout:

    python3 twin/sbom.py build/release > sbom.json

Libraries come from the dynamic linker, headers and what else is compiled in from ninja's own list of inputs. Needs the
folder of a finished build with Ninja, and dpkg."""
import json, os, re, subprocess, sys
from urllib.parse import quote

PROGRAMS = ("tribotwin", "tribotwin-hil", "tribotwin-report")
BY_NAME = {"bin/tribotwin-report": ["libOSMesa.so.8"]}  # what they load while they run


def output(*command):
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def libraries(file):
    """What the dynamic linker loads with it."""
    return {os.path.realpath(path) for path in re.findall(r"(/\S+) \(0x", output("ldd", file))}


def loaded_by(build, program):
    """All files that the dynamic linker loads with it, or while it runs."""
    known = output("/sbin/ldconfig", "-p")
    by_name = [re.search(rf"{re.escape(name)} .*=> (.*)", known)[1] for name in BY_NAME.get(program, [])]
    return libraries(f"{build}/{program}").union(map(os.path.realpath, by_name), *map(libraries, by_name))


def compiled_in(build, targets):
    """Files outside the build and the sources that ninja reads to make the targets: headers, static libraries."""
    inputs = set(output("ninja", "-C", build, "-t", "inputs", *targets).split("\n"))
    objects = {i for i in inputs if i.endswith(".o")}
    files = {i for i in inputs if i.startswith("/usr/")}
    own = False
    for line in output("ninja", "-C", build, "-t", "deps").splitlines():
        if not line.startswith(" "):
            own = line.split(": #deps")[0] in objects
        elif own and line.strip().startswith("/usr/"):
            files.add(line.strip())
    return {os.path.realpath(f) for f in files}


def packages_of(files):
    """Names of the packages that own files; with the path before Debian moved /lib to /usr/lib, too."""
    names = sorted(files | {f.removeprefix("/usr") for f in files if f.startswith("/usr/lib")})
    found = set()
    for at in range(0, len(names), 500):
        answer = subprocess.run(["dpkg-query", "-S", *names[at : at + 500]], capture_output=True, text=True).stdout
        for line in answer.splitlines():
            if ": /" in line and not line.startswith("diversion by "):
                found.update(line.split(": /")[0].split(", "))
    return found


def component(package, linked):
    form = "${Package}\t${Version}\t${Architecture}\t${source:Package}\t${Homepage}"
    name, version, architecture, source, homepage = output("dpkg-query", "-W", "-f", form, package).split("\t")
    found = {
        "type": "library",
        "name": name,
        "version": version,
        "purl": f"pkg:deb/debian/{quote(name, safe='')}@{quote(version, safe='')}?arch={architecture}",
        "properties": [
            {"name": "debian:source", "value": source},
            {"name": "tribotwin:use", "value": "loaded at run time" if linked else "compiled in, or read to build"},
        ],
    }
    if homepage:
        found["externalReferences"] = [{"type": "website", "url": homepage}]
    return found


def main(build):
    programs = [f"bin/{p}" for p in PROGRAMS if os.path.exists(f"{build}/bin/{p}")]
    if not programs:
        sys.exit(f"sbom.py: {build}: holds no bin/tribotwin; name the folder of a finished build")
    loaded = packages_of(set().union(*(loaded_by(build, p) for p in programs)))
    inside = packages_of(compiled_in(build, programs)) - loaded
    version = output(f"{build}/{programs[0]}", "--version").split()[1]
    document = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {"component": {"type": "application", "name": "tribotwin", "version": version.rstrip(",")}},
        "components": [component(p, True) for p in sorted(loaded)] + [component(p, False) for p in sorted(inside)],
    }
    print(json.dumps(document, indent=2))


if len(sys.argv) != 2:
    sys.exit("usage: sbom.py BUILD_FOLDER")
main(sys.argv[1])
