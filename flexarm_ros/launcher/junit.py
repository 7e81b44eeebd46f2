"""A suite's result as JUnit XML, for CI systems."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from flexarm_ros.launcher.suite import SuiteResult


def write_junit(result: SuiteResult, path: Path) -> None:
    """Write one ``testcase`` a case, comparison and claim."""
    name = result.suite.name
    root = ET.Element("testsuite", name=name)
    for case in result.cases:
        failures = [o.text for o in case.outcomes if not o.holds]
        _add(root, f"{name}.cases", case.case.name, case.wall_s, failures)
    for outcome in result.comparisons:
        failures = [] if outcome.holds else [outcome.text]
        _add(root, f"{name}.compare", outcome.text, 0.0, failures)
    for text, verdict, failed, outcomes in result.claims:
        said = [f"verdict: {verdict}", *(o.text for o in outcomes)]
        _add(root, f"{name}.claims", text, 0.0, said if failed else [])
    cases = root.findall("testcase")
    root.set("tests", str(len(cases)))
    root.set("failures", str(len(root.findall("testcase/failure"))))
    root.set("errors", "0")
    root.set("time", f"{sum(case.wall_s for case in result.cases):.3f}")
    path.parent.mkdir(parents=True, exist_ok=True)
    ET.indent(root)
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _add(root: ET.Element, group: str, name: str, wall_s: float, failures: list[str]) -> None:
    case = ET.SubElement(
        root, "testcase", classname=group, name=_printable(name), time=f"{wall_s:.3f}"
    )
    if failures:
        message = _printable("; ".join(failures))
        ET.SubElement(case, "failure", message=message).text = _printable("\n".join(failures))


def _printable(text: str) -> str:
    """Replace what XML 1.0 cannot hold."""
    return "".join(c if c in "\n\t" or (c.isprintable()) else "?" for c in text)
