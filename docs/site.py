"""What the site of the documentation (mkdocs.yml) has besides the pages of this folder.

Pages of the clone that lie elsewhere, and the files that pages link to, which are then beside them.
"""

import posixpath
import re
from functools import partial
from pathlib import Path

from mkdocs.structure.files import File

REPOSITORY = Path(__file__).parent.parent
PAGES = {
    "README.md": "start.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changes.md",
    "config/README.md": "configurations.md",
}
LINK = re.compile(r"\]\((?!https?:|#|mailto:)([^)\s#]+)(#[^)\s]*)?\)")
FORMULA = re.compile(r"\$`(.*?)`\$")  # as GitHub writes $x$


def on_files(files, config):
    """Add the pages that lie elsewhere, and the files that pages link to."""
    texts = {f"docs/{file.src_uri}": file.content_string for file in files.documentation_pages()}
    for path, name in PAGES.items():
        texts[path] = (REPOSITORY / path).read_text(encoding="utf-8")
        content = _with_links(texts[path], posixpath.dirname(path))
        files.append(File.generated(config, name, content=content))
    linked = {
        _in_clone(target, posixpath.dirname(path))
        for path, text in texts.items()
        for target, _ in LINK.findall(text)
    }
    for path in sorted(linked):
        place = _on_site(path)
        if place.startswith("files/"):
            files.append(File.generated(config, place, abs_src_path=str(REPOSITORY / path)))
    return files


def on_page_markdown(markdown, page, config, files):
    """Lead links to where things are on the site; those of pages from elsewhere do already."""
    if page.file.src_uri not in PAGES.values():
        markdown = _with_links(markdown, "docs")
    return FORMULA.sub(r"$\1$", markdown)


def _with_links(text, folder):
    """The text of a page that lies in a folder of the clone, with the links of the site."""
    return LINK.sub(partial(_link, folder), text)


def _link(folder, found):
    return f"]({_on_site(_in_clone(found[1], folder))}{found[2] or ''})"


def _in_clone(target, folder):
    return posixpath.normpath(posixpath.join(folder, target))


def _on_site(path):
    """Where on the site a file of the clone is; a folder has no page, and the gallery is near."""
    if path in PAGES:
        return PAGES[path]
    if path.startswith("docs/") and not path.endswith(".py"):
        return path.removeprefix("docs/")
    return f"files/{path}" if (REPOSITORY / path).is_file() else "gallery.md"
