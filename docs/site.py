"""What the site of the documentation (mkdocs.yml) has besides the pages of this folder.

The README is its first page; files of the clone that pages link to lie beside them; formulas that
GitHub writes as $`x`$ are $x$.
"""

import re
from pathlib import Path

from mkdocs.structure.files import File

REPOSITORY = Path(__file__).parent.parent
START = "start.md"
LINK = re.compile(r"\]\((?!https?:|#|mailto:)([^)\s#]+)(#[^)\s]*)?\)")


def on_files(files, config):
    """Add the README as a page, and what pages link to outside this folder."""
    readme = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    files.append(File.generated(config, START, content=_of_readme(readme)))
    for name in sorted({*_linked(files)}):
        path = str(REPOSITORY / name)
        files.append(File.generated(config, f"files/{name}", abs_src_path=path))
    return files


def on_page_markdown(markdown, page, config, files):
    """Links that leave this folder lead to what is beside the pages."""
    return re.sub(r"\$`(.*?)`\$", r"$\1$", LINK.sub(_inside, markdown))


def _linked(files):
    """Files of the clone that pages and README link to."""
    for file in files.documentation_pages():
        for target, _ in LINK.findall(file.content_string):
            name = _inside_name(target)
            if name and name.startswith("files/"):
                yield name.removeprefix("files/")


def _of_readme(text):
    """The README as a page of this folder: its links begin in the clone's root."""

    def link(found):
        target, place = found[1], found[2] or ""
        if target.startswith("docs/"):
            return f"]({target.removeprefix('docs/')}{place})"
        return f"](../{target}{place})"

    return LINK.sub(link, text)


def _inside(found):
    return f"]({_inside_name(found[1]) or found[1]}{found[2] or ''})"


def _inside_name(target):
    """Where on the site lies what a page links to; None if it is of this folder."""
    if target == "../README.md":
        return START
    if target.startswith("../"):
        name = target.removeprefix("../")
        # A folder has no page of its own.
        return f"files/{name}" if (REPOSITORY / name).is_file() else "gallery.md"
    if target.endswith(".py"):
        return f"files/docs/{target}"
    return None
