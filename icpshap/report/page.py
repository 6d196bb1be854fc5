"""One page that says what was found, how sure that is, and what was run; and its short form."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml
from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup

from icpshap.diagnosis.diagnose import OTHERS
from icpshap.report import (
    advice,
    by_estimator,
    captions,
    diagnosis,
    directions,
    doubts,
    effects,
    fit,
    here,
    in_doubt,
    pose_error,
    tables,
    what_if,
)
from icpshap.report.study import Study

TEMPLATE = Path(__file__).with_suffix(".html")
POINTS_TO_PIXELS = 1.8  # a figure fills the page's column of 58 rem
FEW_PAIRS = 5  # of a sequence, below which medians over them say nothing of the sequence
OF_FIT = ("truth", "counting")  # doubts of a pair that the fit table has


@dataclass(frozen=True)
class Section:
    """What the page says of one experiment, or of one sequence of it.

    figures: paths of SVG files, each beside a .txt with its caption and, for a scene, an .html, for
    a drive, a .csv;
    links: paths of files; ranking, what_if, diagnosis: table, or None. Paths are relative to the
    working directory.
    """

    scope: str
    study: Study
    shap: object
    directions: object
    pairs: object
    fit: object
    what_if: object
    ranking: object
    figures: list
    links: list
    diagnosis: object = None


@dataclass(frozen=True)
class Estimators:
    """What the page says of an experiment of several estimators, or of one sequence of it.

    table: of `by_estimator`; parts: names of the experiments of its estimators; figure: path of an
    SVG file beside a .txt with its caption; links: paths of files.
    """

    scope: str
    study: Study
    table: object
    parts: list
    figure: str
    links: list


def warnings(sections: Sequence[Section]) -> list[doubts.Group]:
    """Everything that makes the sections' numbers doubtful: `doubts.Group`s, the gravest first."""
    found = []
    for section in sections:
        of_section = doubts.of_table(section.shap, section.study)
        of_section += [
            doubt
            for doubt in doubts.of_pairs(section.pairs, section.study)
            if doubt.kind not in OF_FIT
        ]
        found += [(section.scope, doubt) for doubt in of_section]
    return doubts.grouped(found)


def page(
    sections: Sequence[Section],
    run: Mapping[str, Any],
    folder: str | Path,
    comparison: tuple[str, str, str] | None = None,
    joined: Sequence[Estimators] = (),
    partial: Sequence[str] = (),
) -> str:
    """The page as HTML, with every picture inside it.

    run: what `jobs.provenance.provenance` returned; folder: where the page will lie, which links
    start from; comparison: (SVG path, caption, HTML table) of ours against the paper; joined: list
    of `Estimators`, whose parts are among the sections; partial: how much of each sequence this is
    of, in words, if the workflow is not done.
    """
    environment = Environment(
        loader=FileSystemLoader(TEMPLATE.parent), autoescape=True, trim_blocks=False
    )
    run = dict(run)
    configuration = yaml.safe_dump(run.pop("config"), sort_keys=False, allow_unicode=True)
    parts = _parts(joined)
    return environment.get_template(TEMPLATE.name).render(
        findings=_findings(sections, joined),
        symbols=_symbols(sections),
        diagnoses=_diagnoses(sections),
        fits=[(section.scope, *_fit(section)) for section in sections],
        unseen=diagnosis.unseen(),
        warnings=warnings(sections),
        joined=[_described_estimators(part, folder) for part in joined],
        parts=[section.scope for section in sections if section.study.name in parts],
        sections=[_described(section, folder) for section in sections],
        comparison=comparison and _comparison(*comparison),
        partial=partial,
        run=run,
        configuration=configuration,
    )


def summary(
    sections: Sequence[Section], page_path: str | Path, joined: Sequence[Estimators] = ()
) -> str:
    """The end of a run in a few lines: where the results are, and the main findings."""
    lines = ["", f"Report: {page_path}"]
    for part in joined:
        lines.append(
            f"Results: results/{part.scope}/ (figures/by_estimator.png, tables/by_estimator.md), "
            f"and results/{part.study.name}_<estimator>/ of each of {len(part.parts)} estimators"
        )
    for section in _alone(sections, joined):
        lines.append(f"Results: results/{section.scope}/ (figures, tables, shap.parquet)")
    for finding in _findings(sections, joined):
        lines += ["", finding]
    lines += ["", " ".join(_symbols(sections)), ""]
    told: dict[str, list[str]] = {}
    for section in _alone(sections, joined):
        told.setdefault(" ".join(_advice(section)), []).append(section.scope)
    lines += [f"{', '.join(scopes)}: {text}" for text, scopes in told.items() if text]
    groups = warnings(sections)
    if groups:
        several = f"{len(groups)} kinds of warnings, the gravest"
        kinds = several if len(groups) > 1 else "one kind of warnings"
        lines.append(f"The report opens with {kinds}: {groups[0].title}.")
    return "\n".join(lines) + "\n"


def _parts(joined):
    """Names of the experiments that are told together."""
    return {name for part in joined for name in part.parts}


def _alone(sections, joined):
    """The sections that are no parts of an experiment of several estimators."""
    return [section for section in sections if section.study.name not in _parts(joined)]


def _findings(sections, joined):
    """The main findings, a sentence each; of several estimators one of all together."""
    together = [
        by_estimator.finding(part.table, part.study, _errors(part, sections)) for part in joined
    ]
    return together + [_finding(section) for section in _alone(sections, joined)]


def _advice(section):
    return advice.sentences(section.shap, section.fit, section.what_if, section.study)


def _fit(section):
    """How the settings fit the scans: the table, and whether all of it does."""
    return Markup(fit.html(section.fit, section.study)), (section.fit.grade == "fits").all()


def _diagnoses(sections):
    """What is wrong with the pairs of each section: scope, sentence, and the table if it is long.

    What is the same of several sections, since they are of the same pairs, is said once.
    """
    found: dict[Any, Any] = {}
    for section in sections:
        if section.diagnosis is None or not (section.diagnosis.against == OTHERS).any():
            continue  # a pair alone has nothing to be held against
        text = diagnosis.summary(section.diagnosis, section.study.pair)
        sequence = section.diagnosis.sequence.iloc[0]
        found.setdefault((text, sequence), []).append(section)
    return [
        (
            ", ".join(section.scope for section in together),
            text,
            Markup(_pair_by_pair(together)),
        )
        for (text, _), together in found.items()
    ]


def _pair_by_pair(sections):
    first = sections[0]
    shaps = {section.scope: section.shap for section in sections}
    return diagnosis.html(first.diagnosis, shaps, first.study)


def _symbols(sections):
    """What the words and symbols of the findings are, each once."""
    found = ["Clean: no cause is on."]
    if any(len(part.shap) > 1 for part in sections):
        found.append("An instance: one pair at one combination of levels of the causes.")
    found += [text for part in sections for text in captions.symbols(part.study)]
    return list(dict.fromkeys(found))


def _finding(section):
    return captions.finding(section.shap, section.directions, section.study)


def _errors(part, sections):
    """Of each estimator of a part its name, and what `pose_error.before_and_after` returns."""
    scopes = {part.scope.replace(part.study.name, name, 1) for name in part.parts}
    return [
        (section.study.estimator, *pose_error.before_and_after(section.directions, section.study))
        for section in sections
        if section.scope in scopes
    ]


def _described_estimators(part, folder):
    anchor = part.scope.replace("/", "-")
    return {
        "title": part.scope,
        "anchor": anchor,
        "figure": _figure(part.figure, anchor, folder, [], part.study),
        "table": Markup(by_estimator.html(part.table, part.study)),
        "note": by_estimator.note(part.table, part.study),
        "links": [_relative(link, folder) for link in part.links],
    }


def _described(section, folder):
    study = section.study
    anchor = section.scope.replace("/", "-")
    said = _said(section)
    ranked = section.ranking is not None and section.ranking.n_pairs.max() >= FEW_PAIRS
    method = [
        *captions.method(section.shap, study),
        *captions.significance(section.shap, study),
        *captions.noise_floor(section.shap, study),
        *effects.shares(section.shap, study),
        *captions.no_wrong_basin(section.shap, study),
    ]
    return {
        "title": section.scope,
        "anchor": anchor,
        "finding": _finding(section),
        "advice": _advice(section),
        "what_if": section.what_if is not None and Markup(what_if.html(section.what_if, study)),
        "returned": captions.returned(study),
        "method": " ".join(method),
        "here": study.here and Markup(here.html(section.shap, section.diagnosis, study)),
        "here_note": here.NOTE,
        "causes": Markup(effects.table_of_causes(section.shap, study)),
        "causes_note": effects.note_of_causes(section.shap, study),
        "errors": Markup(directions.html(section.directions, study)),
        "errors_of": directions.opening(section.directions, study),
        "errors_note": directions.note(section.directions, study),
        "table": Markup(tables.html(section.ranking, study)) if ranked else "",
        "table_note": tables.note(section.ranking, study) if ranked else "",
        "figures": [_figure(path, anchor, folder, said, study) for path in section.figures],
        "links": [_relative(link, folder) for link in section.links],
    }


def _said(section):
    """What captions say and the page says elsewhere: of all instances, of that shown alone."""
    study, said = section.study, []
    alone = [study.instance(section.shap, study.waterfall)] if study.waterfall else []
    for table in (section.shap, *alone):
        said += [*captions.of_all(table, study), *captions.noise_floor(table, study)]
    # The longest first, so that none that holds another is torn.
    said += directions.sentences(section.directions, study)
    return sorted(said, key=len, reverse=True)


def _figure(path, anchor, folder, said, study):
    """A picture with its caption, but for the sentences that the page has said already."""
    path = Path(path)
    caption = path.with_suffix(".txt").read_text(encoding="utf-8").strip()
    for text in said:
        caption = caption.replace(text, "").strip()
    turning, listed = path.with_suffix(".html"), path.with_suffix(".csv")
    return {
        "name": path.stem,
        "anchor": f"{anchor}-{path.stem}",
        "image": _embedded(path),
        "width": _width(path),
        "caption": " ".join(caption.split()),
        "page": _relative(turning, folder) if turning.exists() else "",
        "table": Markup(in_doubt.html(in_doubt.read(listed), study)) if listed.exists() else "",
    }


def _comparison(path, caption, table):
    return {
        "image": _embedded(path),
        "width": _width(path),
        "caption": caption,
        "table": Markup(table),
    }


def _embedded(path):
    return "data:image/svg+xml;base64," + b64encode(Path(path).read_bytes()).decode()


def _width(path):
    """Width on the page [pixels] of an SVG whose size is in points."""
    width = ElementTree.parse(path).getroot().get("width", "")
    return round(float(width.removesuffix("pt")) * POINTS_TO_PIXELS)


def _relative(path, folder):
    return Path(path).relative_to(folder).as_posix()
