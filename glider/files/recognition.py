"""What a file is, in a few words, for somebody who gave it to the wrong command."""

import json
import zipfile
from pathlib import Path

_MAGIC = {
    b"\x89PNG": "a PNG picture",
    b"\xff\xd8\xff": "a JPEG picture",
    b"%PDF": "a PDF document",
    b"\x1f\x8b": "a gzip archive",
    b"\x89HDF": "an HDF5 file (MATLAB 7.3 writes such .mat)",
    b"MATLAB 5.0": "a MATLAB file",
    b"ULog": "a PX4 ULog",
    b"\x89MCAP": "an MCAP recording",
    b"#ROSBAG": "a ROS bag",
    b"PAR1": "a Parquet table",
    b"\x93NUMPY": "a NumPy array",
    b"\x7fELF": "a program",
}
_HEAD = 4096  # Bytes that are looked at.


def describe_file(path: Path | str) -> str:
    """Returns what a file or folder is, with its article: "a PNG picture".

    Only its beginning is read, but for archives and JSON.

    Raises:
        OSError: it cannot be read.
    """
    path = Path(path)
    if path.is_dir():
        return _describe_folder(path)
    with path.open("rb") as stream:
        head = stream.read(_HEAD)
    if not head:
        return "an empty file"
    for magic, words in _MAGIC.items():
        if head.startswith(magic):
            return words
    if zipfile.is_zipfile(path):
        return _describe_archive(path)
    if head.startswith(b"PK\x03\x04"):
        return "a zip or .npz archive that was cut short"
    try:
        text = head.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if len(head) < _HEAD or error.reason != "unexpected end of data":
            return "a binary file of a kind that is not known"
        text = head[: error.start].decode("utf-8-sig")
    if "\0" in text:
        return "a binary file of a kind that is not known"
    return _describe_text(path, text)


def _describe_folder(folder: Path) -> str:
    if (folder / "campaign.yaml").is_file():
        return "a campaign folder (close-the-loop takes it)"
    if (folder / "report.json").is_file():
        return "the folder of a report (compare takes it)"
    return "a folder"


def _describe_archive(path: Path) -> str:
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    if any(Path(name).name == "campaign.yaml" for name in names):
        return "a packed campaign (close-the-loop takes it)"
    if names and all(name.endswith(".npy") for name in names):
        arrays = ", ".join(name.removesuffix(".npy") for name in names[:4])
        more = ", ..." if len(names) > 4 else ""
        return f"an .npz file with the arrays {arrays}{more}"
    return "a zip archive"


def _describe_text(path: Path, text: str) -> str:
    start = text.lstrip()
    if not start:
        return "a text file without text"
    if start.lower().startswith(("<!doctype html", "<html")):
        return "a web page"
    if start[0] in "{[":
        return _describe_json(path)
    lines = [line for line in text.splitlines() if line.strip()]
    first = next((line for line in lines if not line.startswith("#")), lines[0])
    if path.suffix in (".yaml", ".yml"):
        keys = {line.split(":")[0] for line in lines if ":" in line}
        if "parameters" in keys:
            return "a glider model (YAML)"
        return "a campaign.yaml" if "vehicle" in keys else "a YAML file"
    for separator in ",;\t":
        if first.count(separator):
            cells = first.split(separator)
            return f"a table of {len(cells)} columns, as text"
    return "a text file"


def _describe_json(path: Path) -> str:
    try:
        data = json.loads(path.read_text(encoding="utf-8-sig"))
    except ValueError:
        return "a text file that is no whole JSON"
    if isinstance(data, dict) and "verdict" in data:
        return "the report of a campaign (report.json; compare takes it)"
    if isinstance(data, dict) and {"times", "states"} <= data.keys():
        return "a flight plan (JSON)"
    return "a JSON file"
