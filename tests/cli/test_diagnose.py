"""``piezo-opt diagnose`` and ``piezo-opt bench`` as a user meets them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from piezo_opt import datasets
from piezo_opt.cli import app
from piezo_opt.cli.candidates import read_candidates
from piezo_opt.effects import PrandtlIshlinskii
from piezo_opt.errors import InputError
from piezo_opt.modelfile import read_model
from piezo_opt.readers import write
from problems import hidden_effect
from tests.diagnosis.plants import MOVING, STILL, but, clock, measured, minor_loops, rich

LOOP = str(datasets.path("thesis/hysteresis.csv"))
HEAD = """
from dataclasses import dataclass
from typing import Any, final
from piezo_opt.effects import Creep, Effect
from piezo_opt.effects.base import Chain, Equations, Parameter, Place


class Shared(Effect):
    place = Place.STRAIN
    k = Parameter("m/V^3", "strength", nominal=0.0, null=0.0, typical=(1e-13, 1e-12))
"""
CUBE = """
@final
@dataclass(frozen=True)
class CubedDrive(Effect):
    place = Place.STRAIN
    k = Parameter("m/V^3", "strength", nominal=0.0, null=0.0, typical=(1e-13, 1e-12))

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        return Equations(gives=p.k * chain.drive.value**3)
"""
RAISES = """
@final
@dataclass(frozen=True)
class Clumsy(Effect):
    place = Place.STRAIN
    k = Parameter("m/V", "strength", nominal=0.0, null=0.0, typical=(1e-9, 1e-8))

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        return Equations(gives=p.k * chain.voltage.value)
"""


PATIENCE = ("--max-time", "10 min")
"""A loaded machine changes no answer."""


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(one) for one in arguments])


def refused(result: Result, *words: str) -> None:
    """One sentence on stderr, exit code 2, nothing else."""
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    for word in words:
        assert word in result.stderr


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The creeping stack: a file to fit, and one to judge on."""
    folder = tmp_path_factory.mktemp("records")
    train, test = hidden_effect.data().split(hidden_effect.SPLIT)
    write(train, folder / "train.csv")
    # A record of its own: its clock starts anew.
    write(test.with_(time=test.time - test.time[0]), folder / "test.csv")
    return folder / "train.csv", folder / "test.csv"


@pytest.fixture
def loop(tmp_path: Path) -> Path:
    """The thesis' loop as quick as it gets: virgin, without mechanics."""
    file = tmp_path / "plain.toml"
    file.write_text('effects = ["piezo_gain", "bouc_wen"]\n')
    return file


def test_names_what_is_missing_and_writes_it_down(parts: tuple[Path, Path], tmp_path: Path) -> None:
    train, test = parts
    out, page = tmp_path / "diagnosis.json", tmp_path / "diagnosis.html"
    done = run("diagnose", train, "--test", test, "--json", out, "--report", page, *PATIENCE)
    assert done.exit_code == 0, done.output
    assert all(line.startswith("Diagnosis, ") for line in done.stderr.splitlines())
    assert done.stdout.startswith("Missing: creep. The error falls from 45.7 nm to 14")
    data = json.loads(out.read_text())
    assert data["schema"] == "piezo_opt/diagnosis/1"
    assert data["verdict"] == "missing"
    assert data["unexplained"] is None
    noise = hidden_effect.noise_rms()
    assert data["noise_rms"] == pytest.approx(noise, rel=0.1)
    assert data["rms_baseline"] == pytest.approx(3.17 * noise, rel=0.05)
    assert data["rms_final"] == pytest.approx(noise, rel=0.05)
    (step,) = data["steps"]
    assert step["effect"] == "creep"
    assert step["group"] == ["creep"]
    assert step["rms_before"] == pytest.approx(data["rms_baseline"], rel=1e-5)
    assert step["rms_after"] == data["rms_final"]
    assert step["held_out_before"] > 2.0 * noise
    assert step["held_out_after"] == pytest.approx(noise, rel=0.1)
    assert step["delta_bic"] > 1000.0
    assert step["p_value"] < 1e-6
    assert step["parameters"]["creep.c"]["value"] > 5.0 * step["parameters"]["creep.c"]["std"]
    first = data["suspects"][0]
    assert first["effect"] == "creep"
    assert set(first) == {
        "effect", "score", "predicted_rms", "visibility", "overlaps", "p_value",
    }  # fmt: skip
    assert 0.85 < first["score"] < 0.95
    assert all(0.0 <= s["visibility"] <= 1.0 for s in data["suspects"])
    assert any("repeat the drive" in sentence for sentence in data["advice"])
    assert (data["interrupted"], data["stopped_by"]) == (False, None)
    assert data["elapsed_s"] > 0.0
    # What it ended with is a model like any other.
    assert data["final_model"]["rms"] == data["rms_final"]
    again = run("simulate", train, "--model", out, "--out", tmp_path / "simulated.csv")
    assert again.exit_code == 0, again.output
    assert read_model(out).values["creep.c"] == step["parameters"]["creep.c"]["value"]
    assert re.search(
        "<h1>Diagnosis of [^<]+: an effect is missing</h1>", page.read_text(encoding="utf-8")
    )


def test_mechanics_that_were_found_are_not_said_to_be_unseen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first fit saw none; the sentence on that holds until the ladder finds them."""
    remark = "the record shows no resonance"
    monkeypatch.setattr("piezo_opt.cli.inputs.default_model", lambda _: (STILL, (remark,)))
    withheld = [word for name in but("creep") for word in ("--withhold", name)]
    for base in (MOVING, STILL):
        record, moves = tmp_path / "record.csv", base is MOVING
        write(measured(base, clock(), rich(clock())), record, overwrite=True)
        done = run("diagnose", record, *withheld, *PATIENCE)
        assert done.exit_code == 0, done.output
        assert done.stdout.startswith("Complete once second_order is" if moves else "Complete:")
        assert (remark in done.stdout) is not moves


def test_withheld_effects_are_not_considered(parts: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "d.json"
    withheld = set(but("drift", "asymmetry", "friction", "delay"))
    assert "creep" in withheld
    options = [word for name in sorted(withheld) for word in ("--withhold", name)]
    done = run(
        "diagnose", parts[0], "--split", "20 s", *options, "--json", out, *PATIENCE,
        "--effort", "quick",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    data = json.loads(out.read_text())
    assert not withheld & {s["effect"] for s in data["suspects"]}
    assert not withheld & {s["effect"] for s in data["steps"]}
    # A poorer name for it may be offered, but not as the whole explanation.
    assert data["verdict"] != "complete"
    assert data["rms_final"] > 1.05 * hidden_effect.noise_rms()
    refused(run("diagnose", LOOP, "--withhold", "crepe"), "crepe", "creep")


def test_effects_of_the_user_are_scored(tmp_path: Path, loop: Path) -> None:
    file, out = tmp_path / "mine.py", tmp_path / "d.json"
    file.write_text(HEAD + CUBE)
    done = run(
        *("diagnose", LOOP, "--model", loop, "--start", "rest", *PATIENCE),
        *("--candidates", file, "--json", out),
    )
    assert done.exit_code == 0, done.output
    scored = {s["effect"] for s in json.loads(out.read_text())["suspects"]}
    assert {"creep", "cubed_drive"} <= scored
    # Imported effects and unfinished ones are not the file's own.
    assert "shared" not in scored


def _changed(old: str, new: str) -> str:
    assert old in CUBE
    return HEAD + CUBE.replace(old, new)


GIVEN, AT = "p.k * chain.drive.value**3", HEAD.count("\n") + 9
"""What the effect gives, and the line in which it does."""


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("class Broken(:\n", 1, "SyntaxError"),
        (HEAD.replace("place = Place.STRAIN", "pass"), 8, "declares no place"),
        (HEAD + CUBE + "\nratio = 1 / 0\n", AT + 2, "ZeroDivisionError: division by zero"),
        (HEAD + CUBE + "\nraise SystemExit(0)\n", AT + 2, "leave out exit()"),
        (HEAD + RAISES, AT, "no attribute 'voltage'; the chain has time, command, incoming"),
        (_changed("p.k", "(0.0 if p.k < 0 else p.k)"), AT, "where_(condition, then, otherwise)"),
        (_changed("p.k", "max(p.k, 0.0)"), AT, "min_ or max_"),
        (_changed("p.k", "exit()"), AT, "leave out exit()"),
        (_changed(f"Equations(gives={GIVEN})", "None"), AT - 7, "returned nothing"),
        (_changed(f"Equations(gives={GIVEN})", GIVEN), AT - 7, "returned a SX: return Equations("),
        (_changed(GIVEN, f"1e-7 + {GIVEN}"), AT - 7, "does not vanish at its null, k = 0"),
        (_changed(GIVEN, "chain.drive.value / p.k"), AT - 7, "must be finite"),
        (_changed(GIVEN, "__import__('math').sin(p.k)"), AT - 7, "not of math"),
        (_changed(GIVEN, "'much'"), AT - 7, "returned 'much' as gives"),
        (_changed(GIVEN, f"{GIVEN}, moves={{'q': 1.0}}"), AT - 7, "declare q = State(...)"),
        (_changed(GIVEN, f"{GIVEN}, moves=[1.0]"), AT - 7, "returned a list as moves"),
        (_changed("STRAIN", "INPUT"), AT - 7, "on a line chain.incoming"),
        (_changed("STRAIN", "STRAIN\n    requires = 'loop'"), AT - 7, "write a tuple of 'loop'"),
        (_changed("STRAIN", "STRAIN\n    requires = ('moon',)"), AT - 7, "'channel:NAME'"),
        (_changed("class CubedDrive", "class Creep"), AT - 7, "give the class another name"),
        (_changed("m/V^3", "furlong"), AT - 7, "'furlong' of 'k' is no SI unit"),
        (_changed("m/V^3", "m/W00t"), AT - 7, "unknown unit 'm/W00t'"),
    ],
)  # fmt: skip
def test_what_an_effect_of_the_user_does_not_keep_is_one_sentence_with_its_line(
    tmp_path: Path, text: str, line: int, said: str
) -> None:
    file = tmp_path / "mine.py"
    file.write_text(text)
    refused(run("diagnose", LOOP, "--candidates", file), f"{file}, line {line}: ", said)


def test_what_else_a_candidates_file_may_lack(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    for text, said in (
        ("x = 1\n", "no effect"),
        (_changed("@dataclass(frozen=True)", "@dataclass"), "no frozen dataclass"),
        (_changed("@dataclass(frozen=True)", ""), "no frozen dataclass"),
    ):
        file.write_text(text)
        refused(run("diagnose", LOOP, "--candidates", file), "--candidates", said)
    refused(run("diagnose", LOOP, "--candidates", tmp_path / "no.py"), "no such file")
    text_file = tmp_path / "mine.txt"
    text_file.write_text(CUBE)
    refused(run("diagnose", LOOP, "--candidates", text_file), "end with .py")


def test_the_line_is_said_of_a_file_beside_the_user_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file = Path("mine.py")
    file.write_text(f"{HEAD}\nratio = 1 / 0\n")
    with pytest.raises(InputError, match=rf"mine\.py, line {HEAD.count(chr(10)) + 2}: Zero"):
        read_candidates(file)


def test_candidates_that_cannot_be_made_and_structural_ones(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    picky = CUBE.replace("CubedDrive", "Picky").replace(
        "    place", "    order: int = 0\n    place"
    ) + (
        "\n    def __post_init__(self) -> None:\n"
        "        raise ValueError('order must be positive')\n"
    )  # fmt: skip
    file.write_text(HEAD + picky)
    with pytest.raises(InputError, match=r"Picky cannot be made: ValueError: order must") as told:
        read_candidates(file)
    assert f"{file}, line {(HEAD + picky).count(chr(10))}: " in str(told.value)
    structural = CUBE.replace("CubedDrive", "Base").replace(
        "    place", "    structural = True\n    place"
    )
    file.write_text(HEAD + structural + CUBE)
    found = read_candidates(file)
    assert [effect.name for effect in found.effects] == ["cubed_drive"]
    (remark,) = found.remarks
    assert "Base" in remark
    assert "no gate" in remark


def test_drives_are_written_only_where_there_is_a_folder(tmp_path: Path, loop: Path) -> None:
    refused(run("diagnose", LOOP, "--drives", tmp_path / "no"), "--drives", "no such folder")
    folder = tmp_path / "drives"
    folder.mkdir()
    done = run(
        "diagnose", LOOP, "--model", loop, "--start", "rest", "--drives", folder, "--withhold",
        "drift", *PATIENCE,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    files = sorted(folder.iterdir())
    assert files
    for file in files:
        assert f"Drive: {file}" in done.stdout
        said, header, *_ = file.read_text().splitlines()
        assert said.removeprefix("# ") in done.stdout
        assert header.startswith("time [s],")
        time, volts = np.loadtxt(file, delimiter=",", skiprows=2).T
        # As fast as the record was read, and within the drive that it had.
        assert np.diff(time) == pytest.approx(1.0)
        assert volts.min() >= 0.0
        assert 0.99 * 125.0 < volts.max() < 125.0 + 1e-9


def test_another_law_takes_the_place_of_one_that_leaves_more_than_noise(tmp_path: Path) -> None:
    model, out, file = (tmp_path / name for name in ("still.toml", "d.json", "loop.csv"))
    model.write_text('effects = ["piezo_gain", "bouc_wen", "offset"]\n')
    write(minor_loops(PrandtlIshlinskii(), {"r": 24.0, "rho": 3e-8}, 2e-9), file)
    withheld = but("drift", "asymmetry", "friction", "delay")
    done = run(
        *("diagnose", file, "--model", model, "--json", out, *PATIENCE),
        *(word for name in withheld for word in ("--withhold", name)),
    )
    assert done.exit_code == 0, done.output
    data = json.loads(out.read_text())
    assert (data["verdict"], data["steps"]) == ("complete", [])
    assert data["rms_final"] == pytest.approx(2e-9, rel=0.02)
    better = {rival["effect"] for rival in data["rivals"] if rival["better"]}
    assert "prandtl_ishlinskii" in better
    assert "with prandtl_ishlinskii in the place of bouc_wen" in done.stdout


def test_outputs_are_checked_before_any_work(tmp_path: Path) -> None:
    out = tmp_path / "precious.json"
    out.write_text("precious")
    refused(run("diagnose", LOOP, "--json", out), "exists already")
    refused(run("diagnose", LOOP, "--test", LOOP, "--split", "30 s"), "--test and --split")
    other = tmp_path / "other.csv"
    other.write_text(Path(LOOP).read_text().replace("hysteresis", "other"))
    refused(run("diagnose", LOOP, other, "--split", "30 s"), "--split takes one record")
    refused(run("diagnose", tmp_path / "nowhere.csv"), "no such file")
    refused(run("bench", "hidden", "--json", out), "exists already")
    refused(run("bench", "hidden", "--classes", "crepe"), "no class 'crepe'")
    # Blind, the plants are those of the other hand.
    refused(run("bench", "hidden", "--blind", "--classes", "gain_step"), "name 8 or more")
    refused(run("bench", "hidden", "--blind", "--classes", "gain_switching"), "no class")
    assert out.read_text() == "precious"


def test_help_has_examples() -> None:
    front = run("--help")
    for words in (("diagnose",), ("bench", "hidden")):
        assert words[0] in front.stdout
        page = run(*words, "--help")
        assert page.exit_code == 0
        assert f"  piezo-opt {' '.join(words)}" in page.stdout


def test_bench_hidden_prints_and_writes(tmp_path: Path) -> None:
    out = tmp_path / "hidden.json"
    done = run(
        *("bench", "hidden", "--classes", "none", "--seeds", 1, "--samples", 1000),
        *("--first-seed", 1, "--json", out),
    )
    assert done.exit_code == 0, done.output
    assert "nothing hidden: complete" in done.stdout
    data = json.loads(out.read_text())
    assert data["schema"] == "piezo_opt/hidden/1"
    assert data["confusion"] == {"none": {"complete": 1}}
    assert data["rows"][0]["seed"] == 1


def test_the_time_limit_gives_the_best_so_far_and_every_file(
    parts: tuple[Path, Path], tmp_path: Path
) -> None:
    out, page = tmp_path / "diagnosis.json", tmp_path / "diagnosis.html"
    # Over as soon as the search has begun, however fast the machine is.
    asked = ("diagnose", parts[0], "--max-time", "1 us", "--json", out, "--report", page)
    done = run(*asked)
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("Not finished: the time limit passed before an effect was")
    data = json.loads(out.read_text())
    assert (data["interrupted"], data["stopped_by"]) == (True, "time limit")
    assert (data["verdict"], data["steps"]) == ("open", [])
    assert data["rms_final"] == data["rms_baseline"] == data["final_model"]["rms"]
    assert page.stat().st_size > 20_000
    refused(run("diagnose", parts[0], "--max-time", "-1 s"), "limit of -1 s", "positive")


def test_the_user_puts_effects_in_and_takes_them_out(loop: Path, tmp_path: Path) -> None:
    out = tmp_path / "d.json"
    short = ("--model", loop, "--start", "rest", "--max-time", "1 ms")
    done = run("diagnose", LOOP, *short, "--add", "creep", "--without", "bouc_wen", "--json", out)
    assert done.exit_code == 0, done.output
    names = [e["effect"] for e in json.loads(out.read_text())["final_model"]["model"]["effects"]]
    assert names == ["piezo_gain", "creep"]
    refused(run("diagnose", LOOP, "--model", loop, "--add", "bouc_wen"), "has it already")
    refused(run("diagnose", LOOP, "--add", "creep", "--without", "creep"), "both name creep")


def test_an_error_of_the_program_is_a_sentence_and_a_file_to_send(
    loop: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise RuntimeError("inside")

    monkeypatch.setattr("piezo_opt.cli.diagnose.examine", fails)
    done = run("diagnose", LOOP, "--model", loop, "--start", "rest", *PATIENCE)
    assert done.exit_code == 1
    assert "Traceback" not in done.output
    (sentence,) = done.stderr.strip().splitlines()
    file = Path(sentence.split("send ")[1].split(" with")[0])
    assert "RuntimeError: inside" in file.read_text()
    file.unlink()
