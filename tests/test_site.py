"""The site and the gallery are made; one version stands everywhere."""

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import icpshap

REPOSITORY = Path(icpshap.__file__).parent.parent


def test_the_citation_has_the_version():
    cited = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text(encoding="utf-8"))
    assert str(cited["version"]) == icpshap.__version__


def test_the_changelog_has_the_version():
    assert f"## {icpshap.__version__}" in (REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_site_is_made_and_has_what_pages_link_to(tmp_path):
    mkdocs = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
    subprocess.run([*mkdocs, "--site-dir", tmp_path], cwd=REPOSITORY, check=True)
    page = (tmp_path / "reference" / "index.html").read_text(encoding="utf-8")
    assert all(f'id="icpshap.{name}"' in page for name in ("explain", "diagnose", "read_scan"))
    assert "docs/method.md" not in (tmp_path / "start" / "index.html").read_text(encoding="utf-8")
    assert (tmp_path / "files" / "config.yaml").is_file()


@pytest.mark.job
def test_the_gallery_is_made_by_its_command(tmp_path):
    subprocess.run([sys.executable, "-m", "docs.gallery", tmp_path], cwd=REPOSITORY, check=True)
    page = (tmp_path / "gallery.md").read_text(encoding="utf-8")
    figures = sorted(path.stem for path in (tmp_path / "figures" / "gallery").glob("*.png"))
    assert page.count("## ") == len(figures) == 6
    assert "nan" not in page
