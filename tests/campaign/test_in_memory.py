"""Campaigns of arrays and data frames are those of the same files."""

import dataclasses
import datetime
from decimal import Decimal

import numpy as np
import pytest

from glider.campaign.logs import Campaign, Flight
from glider.campaign.reader import load_campaign
from glider.campaign.writer import save_campaign
from glider.errors import InputError
from glider.physics.model import GliderModel
from glider.sysid.pipeline import close_the_loop
from tests.campaign.importing import foreign

VEHICLE = {"mass": 0.08, "elevator_limits": (-0.4463, 0.9473)}
NAMES = ("time", "x", "z", "pitch", "elevator", "elevator_rate_command")


@pytest.fixture(scope="module")
def campaign():
    return foreign.flights("attached_lift", 4)


def arrays_of(flight):
    columns = (flight.time, *flight.pose.T, flight.elevator, flight.command)
    return dict(zip(NAMES, columns, strict=True))


def table_of(campaign, labels=None):
    parts = [arrays_of(flight) for flight in campaign.flights]
    table = {name: np.concatenate([part[name] for part in parts]) for name in NAMES}
    if labels:
        rows = [len(flight.time) for flight in campaign.flights]
        table["flight"] = np.repeat(np.array(labels, dtype=object), rows)
    return table


def assert_same(made, campaign, **tolerance):
    assert len(made.flights) == len(campaign.flights)
    for flight, true in zip(made.flights, campaign.flights, strict=True):
        for field in dataclasses.fields(Flight)[1:]:
            ours, theirs = getattr(flight, field.name), getattr(true, field.name)
            if field.name in ("attitude", "command_time", "departure"):
                continue
            np.testing.assert_allclose(ours, theirs, **(tolerance or {"rtol": 0}))


def test_some_flights_of_a_campaign_are_chosen_by_name(campaign):
    last = campaign.flights[-1]
    assert campaign.only([last.name.removesuffix(".csv")]).flights == (last,)
    with pytest.raises(InputError, match="no flight 'flight_999'; expected the name"):
        close_the_loop(campaign, flights=["flight_999.csv"])


def test_arrays_give_what_files_give(tmp_path, campaign):
    arrays = [arrays_of(flight) for flight in campaign.flights]
    made = Campaign.from_arrays(arrays, VEHICLE, name="mine", command_rate=50)
    assert_same(made, campaign)
    assert [f.name for f in made.flights] == [f.name for f in campaign.flights]
    assert made.name == "mine" and made.command_rate == 50.0
    assert made.vehicle == {"mass": 0.08} and made.elevator_limits == (-0.4463, 0.9473)
    save_campaign(tmp_path / "c", made)
    assert_same(load_campaign(tmp_path / "c"), made, rtol=1e-8, atol=1e-9)


def test_times_in_a_zone_and_numbers_of_any_kind(campaign):
    """As of a frame of pandas: arrays of objects."""
    begin = datetime.datetime(2026, 5, 1, tzinfo=datetime.UTC)
    table = table_of(campaign, ["a", "b", "a", "c"])  # The label comes again.
    step = datetime.timedelta(seconds=1.0)
    table["time"] = np.array([begin + float(t) * step for t in table["time"]])
    table["x"] = np.array([Decimal(repr(float(x))) for x in table["x"]])
    made = Campaign.from_frame(table, VEHICLE)
    by_name = [campaign.flights[k] for k in (2, 0, 1, 3)]  # "a (2)" comes before "a".
    assert_same(made, dataclasses.replace(campaign, flights=by_name), atol=1e-6)
    assert len({flight.name for flight in made.flights}) == len(campaign.flights)
    table["z"] = np.array([None if k == 7 else z for k, z in enumerate(table["z"])])
    with pytest.raises(InputError, match="column 'z', row 7: found nan"):
        Campaign.from_frame(table, VEHICLE)


def test_flights_by_name_in_any_order(campaign):
    arrays = {"late": campaign.flights[1], 7: campaign.flights[0]}
    made = Campaign.from_arrays({k: arrays_of(f) for k, f in arrays.items()})
    assert [f.name for f in made.flights] == ["flight_007.csv", "flight_late.csv"]
    np.testing.assert_array_equal(made.flights[0].pose, campaign.flights[0].pose)


def test_a_vehicle_in_each_form(tmp_path, campaign):
    arrays = [arrays_of(flight) for flight in campaign.flights]
    model = GliderModel()
    model.save(tmp_path / "model.yaml")
    text = "vehicle: {mass: 0.08}\ncommand_rate: 50\n"
    (tmp_path / "campaign.yaml").write_text(text)
    for vehicle in (model, model.parameters, tmp_path / "model.yaml"):
        made = Campaign.from_arrays(arrays, vehicle)
        assert made.vehicle["mass"] == model.parameters.mass
        assert made.elevator_limits == tuple(model.parameters.elevator_limits)
    made = Campaign.from_arrays(arrays, str(tmp_path / "campaign.yaml"))
    assert made.vehicle == {"mass": 0.08} and made.command_rate == 50.0
    assert Campaign.from_arrays(arrays, {"mass": np.float32(1.0)}).vehicle["mass"] == 1


def test_columns_units_and_frame_as_in_a_map(campaign):
    flights = [
        {
            "t": 1e3 * flight.time,
            "p": foreign.position(flight),
            "theta": -np.degrees(flight.pose[:, 2]),
            "de": np.degrees(flight.elevator),
            "rate": np.degrees(flight.command),
        }
        for flight in campaign.flights
    ]
    made = Campaign.from_arrays(
        flights,
        {"elevator_rate_limit": 13.0},
        columns={"time": "t", "x": "p[0]", "z": "p[2]", "pitch": "theta"}
        | {"elevator": "de", "elevator_rate_command": "rate"},
        units={"time": "ms", "angle": "deg", "rate": "deg/s"},
        frame={"pitch": "nose_up"},
    )
    assert_same(made, campaign, rtol=0, atol=1e-9)


def frames(table):
    """The same table in each library that is installed."""
    yield table
    kinds = [(name, np.asarray(v).dtype) for name, v in table.items()]
    structured = np.empty(len(table["x"]), dtype=kinds)
    for name, values in table.items():
        structured[name] = values
    yield structured
    for module, make in (
        ("pandas", "DataFrame"),
        ("polars", "DataFrame"),
        ("pyarrow", "table"),
    ):
        try:
            library = __import__(module)
        except ImportError:
            continue
        yield getattr(library, make)({k: v.tolist() for k, v in table.items()})


@pytest.mark.parametrize("labels", [None, [3, 4, 5, 6], ["a", "b", "c d", "e"]])
def test_a_frame_of_several_flights(campaign, labels):
    for frame in frames(table_of(campaign, labels)):
        made = Campaign.from_frame(frame, VEHICLE)
        assert_same(made, campaign)
        first, last = ("000", "003") if labels is None else (labels[0], labels[-1])
        pad = "{:03d}" if isinstance(first, int) else "{}"
        assert made.flights[0].name == f"flight_{pad.format(first)}.csv"
        assert made.flights[-1].name == f"flight_{pad.format(last)}.csv"


class Frame:
    """Named columns and nothing else, as a library that we do not know may have."""

    def __init__(self, table):
        self._table, self.columns = table, list(table)

    def __getitem__(self, name):
        return self._table[name]


def test_a_frame_with_missing_cells_times_and_texts(campaign):
    table = table_of(campaign)
    count = len(campaign.flights[0].time)
    table["flight"] = [1.0 if i < count else None for i in range(len(table["x"]))]
    table["time"] = np.datetime64("2026-05-01T10") + np.round(
        1e9 * table["time"]
    ).astype("timedelta64[ns]")
    table["note"] = ["calm"] * len(table["x"])
    table["run"] = table.pop("flight")
    made = Campaign.from_frame(Frame(table), flight="run")
    assert [flight.name for flight in made.flights] == ["flight_001.csv"]
    assert len(made.flights[0].time) == count
    assert abs(made.flights[0].time[1] - campaign.flights[0].time[1]) < 1e-8


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"z": None}, "flight_001.csv: header: there is no column 'z'"),
        ({"pitch": np.nan}, "flight_001.csv: column 'pitch', row 0: found nan"),
        ({"x": "far"}, "flight_001.csv: column 'x', row 0: found 'far'"),
        ({"z": "short"}, "flight_001.csv: column 'z' has 9 values; expected 103"),
        ({"pitch": 50.0}, r"flight_001.csv: column 'pitch', row 0: .*degrees"),
    ],
)
def test_errors_name_the_flight_and_the_column(campaign, change, words):
    arrays = [arrays_of(flight) for flight in campaign.flights]
    [(name, value)] = change.items()
    if value is None:
        del arrays[1][name]
    elif value == "short":
        arrays[1][name] = arrays[1][name][:9]
    else:
        arrays[1][name] = [value, *arrays[1][name][1:].tolist()]
    with pytest.raises(InputError, match=words):
        Campaign.from_arrays(arrays)


def test_errors_of_a_frame_name_the_row_of_the_flight(campaign):
    table = table_of(campaign, [0, 1, 2, 3])
    row = len(campaign.flights[0].time) + 5
    table["z"][row] = np.inf
    with pytest.raises(InputError, match=r"flight_001.csv: column 'z', row 5: "):
        Campaign.from_frame(table)


def test_unknown_fields_are_refused(campaign):
    arrays = [arrays_of(flight) for flight in campaign.flights]
    for vehicle, fields, words in (
        ({"mas": 1.0}, {}, "'mas' of vehicle.*did you mean 'mass'"),
        (None, {"comand_rate": 50}, "did you mean 'command_rate'"),
        ({"mass": "light"}, {}, "vehicle.mass' is 'light'; expected a number"),
    ):
        with pytest.raises(InputError, match=words):
            Campaign.from_arrays(arrays, vehicle, **fields)
    with pytest.raises(InputError, match="holds no flight"):
        Campaign.from_arrays([])


@pytest.mark.parametrize("table", [1, None, "time", [[0.0, 1.0]], np.zeros((3, 4))])
def test_what_has_no_named_columns_is_refused(table):
    with pytest.raises(InputError, match=r"flight_000\.csv.*named columns"):
        Campaign.from_arrays([table], {}, name="lab")


@pytest.mark.parametrize("flights", ["a table", 5, "log.csv", None])
def test_what_is_no_list_of_flights_is_named(campaign, flights):
    """One table instead of a list of tables, or no table at all."""
    words = "flights is .*; expected a list of tables"
    if flights == "a table":
        flights = arrays_of(campaign.flights[0])
        words = r"flight_time\.csv is .*; expected a table of a flight"
    with pytest.raises(InputError, match=words):
        Campaign.from_arrays(flights, VEHICLE)


def test_units_without_columns(campaign):
    """The names of the quantities are those of the columns."""
    tables = [arrays_of(flight) for flight in campaign.flights]
    tables = [{**table, "time": 1000.0 * table["time"]} for table in tables]
    units = {"time": "ms"}
    made = Campaign.from_arrays(tables, VEHICLE, command_rate=50, units=units)
    assert_same(made, campaign, atol=1e-9)


@pytest.mark.parametrize("kind", [float, int, object])
def test_masked_values_are_missing(campaign, kind):
    """What stands under a mask is not used."""
    table = arrays_of(campaign.flights[0])
    hidden = np.arange(len(table["x"])) == 40
    values = np.where(hidden, 99, table["x"] if kind is not int else 0)
    table["x"] = np.ma.masked_array(values.astype(kind), mask=hidden)
    with pytest.raises(InputError, match="column 'x', row 40: found nan"):
        Campaign.from_arrays([table], VEHICLE)
