"""Modules of version 0.1 by their old names: pickles and private imports still load, and warn."""

import base64
import importlib
import inspect
import json
import pickle
import subprocess
import sys
import warnings
import zlib
from pathlib import Path

import pytest

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src import moved

DATA = Path(__file__).parents[1] / "data"

#: `pickle.dumps` of the scene below, made with version 0.1; compressed, in base 85.
OLD = (
    "c-nncy^q{P6hFANckebAg%D8$q!cu{6kE~X2MG&Wvbu05r69tL?eWg!#vU^td$&QLAO%FEkti61f)EAJ&`?w6Pe6"
    "2Zp{5C43JTt{cfH;u!p(Z$n|U9<_xnBH?R@jNyH-8!CBfso%m<NH$v`Kxpxy<C)$iAS`!oNEzw9=nl;^b2To!)xq"
    "6?yl;;A2lJ)uHGn%|**xbtuxF^q&fp~?@}=1=qTg$JiCOLXoooI8&jXE&0HPk8bCt360drrgY0?uW1c@Y{{QKfhF"
    "6&Z%KC_3nJTrG+uPUcWR=ttXj)s{ed|&v$OaK#P$!w1mdGf<mTZ;$24@Swe23NTD+*++Ao#Uz&SIi`OPYs1rtWz_"
    "YV=@Xnj?lL?N|H#Fm!iE?tf?4&WayLX$lQCR^|!k8CC&AdCCC~kN{M5Kt}(l-#g;Do1!f#KerzlOhF_}B$yJ&Fa|"
    "E{G{i$Gde*<bsJMD)nEwK&lkZ;c)4cLXy!7Hg@4LRRtBEz3ReI{n|9wDG0W<@sTAdmXQDiFrSpu!a$F`SlS}Ra__"
    "rdE>oUyn!<ZOms6TXg-ogT_ic<>0Cl49QV`Wa*N`VjE$v6=M!jmdF~oo?m^wHi1|eUeZV4eYV7xEWSyLr@gYCIMG"
    "g8v0Xi?eV{QAB;T{ac`4|9V#aTj0@cOET#&_plCnm7^OU0R{v+^nMsND6=g6x_xU;pQ!2d5ezS6a|Ll-u<ecmOB$"
    "$aU217R#@$adymp9s4>^0r==_q=i%;a3;IsEPGlWm=ODiR$3MUP3uT>0Sa>3+j-dDoQ$Oms-V|7ntV*fXYA1^c;0"
    "q;X#0ukGpUqMwVN5vZvD?x%2IeOw%9PCgHt2;Ia8dAu+9;|u(!4qXJ45?zb`dC{NnQ$66-pqN(y;nZmuPKsiW{Yy"
    "!WpzKH4tP{VPxp06BDSPU2TSYn+;dto=^#bSF=H>cn%_&;*7(?l2O&#XCbUNs1lHR^2{t<h$Ke5cYd#JHfA^2dv5"
    "DpUQnX038E2&hGI9D13Nnd(ob}2WP^KmYfmY;)&NB#*=6weM;&(Sd2?VNu!wy)W@MYiW0s6ria0VlX4#lc#*8&*8"
    "3%Z*>qm3d)k;C3poZAK>+LV(*pkMlY{=er{i`x3ytr8%oqGXvl2r0Qz%|etW(u6sAfs2>c(?Mo&LOV1DuN4hiIaz"
    "kc5ttvwgs7ie1HZ@B9AI(c*2ncICx!>q^3hSm-@DiH7tD%x{#_?eux^H%&?;~2Leh=4=ZoGt8amVwb8x2qWF0n7h"
    "bD_ELT~KI|C}?1&DP@#PVZSEvNvAeC*kSCdbe0dw22a;86VlE?dN+k89`%ueCl1>_>LnZNkDV3{Vq}U3R^Si4qn8"
    "yXE@u^@G1PIPM%NCRPv?HCl!CPYuc*H!6IOjm^E=N+euCDONHup8d2^y@gep!CFHAZ9Mo7reWmD"
)


def scene():
    made = libmpm.Scene(
        dimension=2,
        lower=(0, 0),
        upper=(2, 1),
        cell_size=0.125,
        gravity=(0, -9.81),
        method=libmpm.Method(transfer="APIC"),
    )
    made.add_body(
        name="water",
        shape=shapes.Box(lower=(0, 0), upper=(1, 0.5)),
        material=materials.TaitFluid(),
    )
    made.add_body(
        name="ball",
        shape=shapes.Sphere(centre=(1.5, 0.5), radius=0.25),
        material=materials.LinearElastic(density=1000.0, youngs_modulus=1e6, poissons_ratio=0.25),
    )
    made.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    made.add_sensor(name="energy", sensor=sensors.Energy(interval=0.125))
    made.add_sensor(name="track", sensor=sensors.BodyTracker(body="ball", interval=0.125))
    return made


def test_a_pickle_of_the_version_before_is_the_same_scene():
    with pytest.warns(DeprecationWarning, match=r"is libmpm\._src\.scene\.scene\.Scene since"):
        old = pickle.loads(zlib.decompress(base64.b85decode(OLD)))
    assert old == scene()
    assert type(old.bodies[1].shape) is shapes.Sphere


@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
@pytest.mark.parametrize("name", sorted(p.stem for p in (DATA / "scenes_0.1").glob("*.json")))
def test_scene_files_of_the_version_before_run(name, tmp_path):
    """Files that 0.1 has written, with every kind of value that it had; FOLDER: where files lie."""
    text = (DATA / "scenes_0.1" / f"{name}.json").read_text(encoding="utf-8")
    file = tmp_path / "scene.json"
    file.write_text(text.replace("FOLDER", str(DATA / "scenes_0.1")), encoding="utf-8")
    found = libmpm.Scene.load(file)
    own = {s.name: lambda sim: 1.0 for s in found.sensors if isinstance(s.sensor, sensors.Custom)}
    sim = libmpm.Simulation(found, device="cpu", threads=1, functions=own)
    sim.step(3)
    assert sim.time > 0 and libmpm.Scene.from_dict(found.to_dict()) == found


def test_every_old_module_is_a_module():
    for old, new in moved.MOVED.items():
        new_module = importlib.import_module(f"libmpm._src.{new}")
        sys.modules.pop(f"libmpm._src.{old}", None)
        with pytest.warns(DeprecationWarning, match=f"libmpm._src.{new} since"):
            assert importlib.import_module(f"libmpm._src.{old}") is new_module


def test_modules_in_moved_folders_exist_once():
    with pytest.warns(DeprecationWarning):
        old = importlib.import_module("libmpm._src.triangular.mesh")
    assert old.Mesh is libmpm.grids.Mesh


@pytest.mark.parametrize("folder", moved.FOLDERS)
def test_names_of_modules_that_are_folders_now(folder):
    module, names = moved.FOLDERS[folder]
    package = importlib.import_module(f"libmpm._src.{folder}")
    for name in names.split():
        with pytest.warns(DeprecationWarning, match=name):
            found = getattr(package, name)
        assert found is getattr(importlib.import_module(f"libmpm._src.{module}"), name)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        package.nothing  # noqa: B018


def test_nothing_of_libmpm_uses_old_names():
    """Importing every module, as a program that treats warnings as errors would."""
    program = (
        "import importlib, pkgutil, libmpm\n"
        "for module in pkgutil.walk_packages(libmpm.__path__, 'libmpm.'):\n"
        "    if not module.name.endswith(('__main__', '_cuda')):\n"
        "        importlib.import_module(module.name)\n"
    )
    command = [sys.executable, "-W", "error::DeprecationWarning:libmpm", "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "since libmpm 0.2" not in done.stderr, done.stderr


def test_the_public_surface_is_small_and_whole():
    assert len(libmpm.__all__) < 40
    assert set(libmpm.__all__) | {"__version__"} == set(dir(libmpm)) and libmpm.__version__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in libmpm.__all__:
            assert getattr(libmpm, name) is not None
    program = "import libmpm; print(libmpm.cases.names()[0], libmpm.compat.claymore.__name__)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, "modules need no import of their own: " + done.stderr


@pytest.mark.parametrize(("name", "module"), libmpm._MOVED.items())
def test_public_names_that_moved_into_modules(name, module):
    with pytest.warns(DeprecationWarning, match=rf"libmpm\.{name} is libmpm\.{module}\.{name}"):
        found = getattr(libmpm, name)
    assert found is getattr(importlib.import_module(f"libmpm.{module}"), name)
    assert name in importlib.import_module(f"libmpm.{module}").__all__


def test_smoothing_is_part_of_methods():
    sys.modules.pop("libmpm.smoothing", None)
    with pytest.warns(DeprecationWarning, match="part of libmpm.methods"):
        old = importlib.import_module("libmpm.smoothing")
    assert old.smooth is libmpm.methods.smooth


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [
        ("shapes", "Mesh", "SurfaceMesh"), ("debris", "Field", "DebrisField"),
        ("studies", "Case", "StudyCase"), ("studies", "grid", "full_factorial"),
        ("debris", "Tetrahedra", "DebrisMesh"), ("design", "Friction", "DebrisFriction"),
    ],
)  # fmt: skip
def test_names_that_meant_two_things_warn(module, old, new):
    place = importlib.import_module(f"libmpm.{module}")
    with pytest.warns(DeprecationWarning, match=f"libmpm.{module}.{new} since"):
        assert getattr(place, old) is getattr(place, new)
    assert old not in place.__all__ and new in place.__all__
    with pytest.raises(AttributeError, match="no_such"):
        _ = place.no_such


def test_no_name_has_two_meanings():
    """Whatever module a class or function of a user's is found in, it is the same one."""
    meant: dict[str, object] = {}
    for module in ["", *(f".{name}" for name in libmpm.__all__ if name.islower())]:
        place = importlib.import_module("libmpm")
        for part in module.split(".")[1:]:
            place = getattr(place, part)
        for name in getattr(place, "__all__", ()):
            if inspect.ismodule(place) and name != "names":  # what the module has, of each
                thing = getattr(place, name)
                assert meant.setdefault(name, thing) is thing, f"{module}.{name}"
    assert len(meant) > 200


def _parameters(thing):
    """The arguments of a callable by name, those that were renamed by their old name too."""
    found = inspect.signature(thing).parameters.values()
    return {p.name for p in found if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)}


#: Arguments that have a new name; the old one warns (`keywords_only`).
RENAMED = {"animate": {"color"}, "Simulation.plot": {"color"}, "Simulation.view": {"color"}}


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_every_public_name_and_argument_of_the_version_before_is_there():
    """Names, members and arguments as 0.1 had them: its scripts find all of them."""
    then = json.loads((DATA / "public_names_0.1.json").read_text(encoding="utf-8"))
    gone, seen = [], 0
    for module, names in then.items():
        place = importlib.import_module(module)
        for name, members in names.items():
            thing = getattr(place, name)
            for member, arguments in members.items():
                label = f"{name}.{member}" if member else name
                fields = getattr(thing, "__annotations__", {})
                if member and not hasattr(thing, member) and member not in fields:
                    gone.append(f"{module}.{label}")
                    continue
                seen += 1
                called = getattr(thing, member) if member and arguments else thing
                if arguments:
                    missing = set(arguments) - _parameters(called) - RENAMED.get(label, set())
                    gone += [f"{module}.{label}({argument}=)" for argument in sorted(missing)]
    assert seen > 1000 and not gone, gone
