"""A file that was given to the wrong command is told by what it is."""

import numpy as np
import pytest

from glider.errors import InputError
from glider.files.recognition import describe_file
from glider.paths import models_path
from glider.verification.funnel.file import read_file
from tests.helpers.campaigns import campaign_path

CONTENTS = {
    b"": "an empty file",
    b" \n": "a text file without text",
    b"\x89PNG\r\n": "a PNG picture",
    b"%PDF-1.7": "a PDF document",
    b"MATLAB 5.0 MAT-file": "a MATLAB file",
    b"ULog\x01\x12\x35": "a PX4 ULog",
    b"\x00\x01\x02\xff\xfe": "a binary file of a kind that is not known",
    b"time,x,z,pitch\n0,1,2,3\n": "a table of 4 columns, as text",
    b"time;x;z\n0;1;2\n": "a table of 3 columns, as text",
    b"<!DOCTYPE html><html>": "a web page",
    b'{"verdict": "no_effect"}': "the report of a campaign",
    b'{"times": [], "states": []}': "a flight plan",
    b'{"a": 1}': "a JSON file",
    b'{"a": ': "a text file that is no whole JSON",
    b"dear diary": "a text file",
    "Höhe".encode("latin-1"): "a binary file",
    b"PK\x03\x04 and no more": "cut short",
}


@pytest.mark.parametrize(("content", "words"), CONTENTS.items())
def test_any_file_is_told_by_what_it_is(tmp_path, content, words):
    path = tmp_path / "file"
    path.write_bytes(content)
    assert words in describe_file(path)
    with pytest.raises(InputError) as error:
        read_file(path)
    assert f"{path}: is {describe_file(path)}, not a funnel;" in str(error.value)
    assert str(error.value).count("\n") == 0


def test_files_and_folders_of_this_package_are_known(tmp_path):
    assert describe_file(campaign_path("a")).startswith("a campaign folder")
    assert describe_file(models_path()) == "a folder"
    truths = models_path("truths", "head_wind.yaml")
    assert describe_file(truths) == "a glider model (YAML)"
    packed = models_path("campaigns", "head_wind.zip")
    assert describe_file(packed).startswith("a packed campaign")
    np.savez(tmp_path / "other.npz", a=np.zeros(2), b=np.zeros(1))
    assert describe_file(tmp_path / "other.npz") == "an .npz file with the arrays a, b"


def test_a_letter_that_the_end_of_the_head_cuts_is_still_text(tmp_path):
    path = tmp_path / "long.txt"
    path.write_text("x" * 4095 + "é" * 10, encoding="utf-8")
    assert describe_file(path) == "a text file"
