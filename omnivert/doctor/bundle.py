"""All that somebody else needs to understand a report, in one file to mail."""

import json
import zipfile
from pathlib import Path
from typing import Any

from omnivert.doctor.evidence import Evidence
from omnivert.pictures.plain import plain


def write_bundle(path: Path, evidence: Evidence, report: dict[str, Any], text: str) -> None:
    """Report, settings in force, versions, and what each service last said of itself; no picture, no store.

    raises  OSError when it cannot be written
    """
    services = [
        {"service": s.name, "instance": s.instance, "present": s.present, "health": plain(s.health)}
        for s in evidence.bus.services
    ]
    host = {"python": evidence.host.python, "system": evidence.host.system, "versions": evidence.host.versions}
    parts = {
        "report.json": report,
        "config.json": evidence.config.model_dump(mode="json"),
        "versions.json": host,
        "health.json": services,
    }
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("report.txt", text)
        for name, part in parts.items():
            file.writestr(name, json.dumps(part, indent=1))
