"""MCAP files of JSON and protobuf give the numbers of their topics; what is not read is said."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jaxmodel import import_case, read_table
from jaxmodel.base.errors import MeasurementError
from tests.data.importing.benches import cell_log

LOG = cell_log().assign(time_s=lambda log: log.time_s / 10.0)
EPOCH_S = 1_720_000_000


def write(path: Path, encoding: str) -> None:
    """A battery, and a thermometer every tenth time."""
    writer_of = pytest.importorskip("mcap.writer")
    with path.open("wb") as stream:
        writer = writer_of.Writer(stream)
        writer.start()
        kind, schema, pack = _battery(encoding)
        schema_id = writer.register_schema(name="Battery", encoding=kind, data=schema)
        battery = writer.register_channel(topic="/battery", message_encoding=encoding, schema_id=schema_id)
        warm = writer.register_channel(topic="/cell_temperature", message_encoding="json", schema_id=0)
        for place, row in enumerate(LOG.itertuples()):
            time_ns = EPOCH_S * 10**9 + round(1e9 * row.time_s)
            writer.add_message(battery, time_ns, pack(row.voltage_V, -row.current_A), time_ns)
            if place % 10 == 0 and encoding == "json":
                data = json.dumps({"timestamp": {"sec": 1}, "value": 20.0 + row.time_s / 100.0}).encode()
                writer.add_message(warm, time_ns, data, time_ns)
        writer.finish()


def _battery(encoding: str) -> tuple[str, bytes, Any]:
    """Return the name of a schema's form, the schema and what packs a voltage and a current."""
    if encoding != "protobuf":
        return (
            "jsonschema",
            b'{"type": "object"}',
            lambda u, i: json.dumps({"state": {"voltage": u, "current": i}}).encode(),
        )
    descriptor = pytest.importorskip("google.protobuf.descriptor_pb2")
    pool = pytest.importorskip("google.protobuf.descriptor_pool").DescriptorPool()
    factory = pytest.importorskip("google.protobuf.message_factory")
    pytest.importorskip("mcap_protobuf")
    file = descriptor.FileDescriptorProto(name="battery.proto", syntax="proto3")
    message = file.message_type.add(name="Battery")
    for number, name in enumerate(("voltage", "current"), start=1):
        message.field.add(name=name, number=number, type=1, label=1)
    pool.Add(file)
    made = factory.GetMessageClass(pool.FindMessageTypeByName("Battery"))
    schema = descriptor.FileDescriptorSet(file=[file]).SerializeToString()
    return "protobuf", schema, lambda u, i: made(voltage=u, current=i).SerializeToString()


def test_topics_of_json_are_columns(tmp_path: Path):
    path = tmp_path / "drive.mcap"
    write(path, "json")
    frame = read_table(path).frame
    np.testing.assert_allclose(frame["Time (s)"], EPOCH_S + LOG.time_s)
    np.testing.assert_allclose(frame["/battery.state.voltage"], LOG.voltage_V)
    warm = frame["/cell_temperature"].dropna()
    np.testing.assert_allclose(warm, 20.0 + LOG.time_s[: warm.size] / 100.0)


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
def test_an_mcap_file_is_a_case(tmp_path: Path, encoding: str):
    path = tmp_path / "drive.mcap"
    write(path, encoding)
    (run,) = import_case(path, "cell", ambient=25.0, capacity_Ah=3.0).runs
    np.testing.assert_allclose(run.log.columns["voltage_V"], LOG.voltage_V)
    np.testing.assert_allclose(run.log.columns["current_A"], LOG.current_A)


def test_messages_of_another_form_are_said(tmp_path: Path):
    path = tmp_path / "drive.mcap"
    write(path, "cbor")
    with pytest.raises(MeasurementError, match="holds messages in 'cbor', and JSON or protobuf with numbers is read"):
        read_table(path)


def test_an_mcap_file_without_its_package_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "mcap.reader", None)
    path = tmp_path / "drive.mcap"
    path.write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(
        MeasurementError, match=r"needs the package mcap: install jaxmodel\[mcap\], or export its topics"
    ):
        read_table(path)


def test_a_damaged_mcap_file_is_said(tmp_path: Path):
    pytest.importorskip("mcap")
    path = tmp_path / "drive.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + bytes(range(200)))
    with pytest.raises(MeasurementError, match="cannot be read by mcap"):
        read_table(path)
