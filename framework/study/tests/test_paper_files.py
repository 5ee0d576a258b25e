"""What `navloom report --tex --csv` writes for one's own paper."""

from __future__ import annotations

import csv
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from navloom_study.report.paper_files import latex, statistics_sentence, tex_files
from navloom_study.report.study_files import StudyFiles, read_study
from study_rig import straight, study_folder

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study in which `vfh_star@printed` succeeds in every world, and `vff` in one of two."""

    def trail(method: str, world: str, seed: int) -> object:
        won = method != "vff" or int(world.rpartition(":")[2]) % 2 == 0
        return straight("succeeded" if won else "stuck", 18 + seed)

    worlds = [f"clutter:{number}" for number in range(12)]
    path = tmp_path_factory.mktemp("study") / "s"
    return study_folder(path, ["vff", "vfh_star@printed"], worlds, [0, 1], trail)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def study(folder: Path) -> StudyFiles:
    return read_study(folder)


@pytest.fixture(scope="module")
def files(study: StudyFiles) -> dict[str, str | bytes]:
    return tex_files(study)


def test_letters_of_latex_are_escaped() -> None:
    assert latex("a_b & 5 % ↑ −1 < 2 → ∞") == r"a\_b \& 5 \% $\uparrow$ $-$1 $<$ 2 ? ?"


def test_the_sentence_on_statistics_names_what_was_done(study: StudyFiles) -> None:
    told = statistics_sentence(study)
    assert told.startswith("Each method drove 12 worlds with 2 seeds each")
    assert "10000 resamples of whole worlds" in told
    assert "p of the primary metric (success) is adjusted over the methods after Holm" in told


def test_a_table_has_the_numbers_of_the_report(files: dict[str, str | bytes]) -> None:
    table = str(files["metrics-1.tex"])
    assert r"metric & vff & vfh\_star@printed \\" in table
    assert r"success $\uparrow$ & 0.50 & 1.00 \\" in table


def test_braces_and_environments_match(files: dict[str, str | bytes]) -> None:
    for name, text in files.items():
        if isinstance(text, str):
            begun, ended = (re.findall(rf"\\{word}{{(\w+)}}", text) for word in ("begin", "end"))
            bare = re.sub(r"\\.", "", text)
            assert sorted(begun) == sorted(ended), name
            assert bare.count("{") == bare.count("}"), name
            assert text.isascii(), name


def test_figures_are_vectors_with_equal_bytes(study: StudyFiles, files: dict[str, str | bytes]) -> None:
    figures = {name: content for name, content in files.items() if name.endswith(".pdf")}
    assert len(figures) > 5
    again = tex_files(study)
    for name, content in figures.items():
        assert isinstance(content, bytes)
        assert content.startswith(b"%PDF") and b"/Subtype /Image" not in content
        assert content == again[name]


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no LaTeX is installed")
def test_the_page_compiles_without_a_warning(files: dict[str, str | bytes], tmp_path: Path) -> None:
    for name, content in files.items():
        (tmp_path / name).write_bytes(content.encode() if isinstance(content, str) else content)
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    assert re.findall(r"LaTeX Warning: (?!Label).*|Overfull.*", done.stdout) == []


def test_the_command_writes_both_folders(in_process: Run, folder: Path) -> None:
    code, said, wrong = in_process("report", str(folder), "--tex", "--csv")
    assert code == 0, wrong
    assert "tex/paper.tex" in said
    head, first, *_ = csv.reader((folder / "csv" / "metrics.csv").open(encoding="utf-8"))
    assert (head[:4], first[:2]) == (["method", "success", "success_low", "success_high"], ["vff", "0.5"])
    assert [*csv.reader((folder / "csv" / "outcomes.csv").open(encoding="utf-8"))][1] == ["vff", "12", "12"]
