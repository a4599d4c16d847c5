"""The messages are the Rust types, to the byte."""

import ctypes
import gc

import numpy
import pytest

from observer_client import Estimate, Measurement, Reply, Status, payload, status_bits


def rust_type(field_type):
    scalars = {ctypes.c_double: "f64", ctypes.c_uint64: "u64", ctypes.c_uint32: "u32", ctypes.c_uint8: "u8"}
    if issubclass(field_type, ctypes.Array):
        return f"[{scalars[field_type._type_]}; {field_type._length_}]"
    return scalars.get(field_type, field_type.__name__)


def test_every_message_has_the_layout_of_the_rust_type(facts):
    assert len(facts["layout"]) == 9
    for rust in facts["layout"]:
        message = getattr(payload, rust["name"])
        fields = []
        for name, field_type in message._fields_:
            place = getattr(message, name)
            fields.append([name, rust_type(field_type), place.offset, place.size])
        assert fields == rust["fields"], rust["name"]
        assert ctypes.sizeof(message) == rust["size"]
        assert ctypes.alignment(message) == rust["alignment"]
        assert message.type_name() == rust["type_name"]


def test_array_fields_are_numpy_views_that_keep_their_message_alive():
    estimate = Estimate(status=3)
    view = estimate.velocity_m_s.numpy()
    assert view.dtype == numpy.float64 and view.shape == (3,)
    view[:] = [1.0, 2.0, 3.0]
    assert estimate.velocity_m_s[:] == [1.0, 2.0, 3.0], "a view, not a copy"
    assert numpy.shares_memory(numpy.asarray(estimate.velocity_m_s), view)
    del estimate
    gc.collect()
    [Estimate(status=i) for i in range(100)]
    assert view.tolist() == [1.0, 2.0, 3.0]
    assert Estimate().state.numpy().shape == (12,)


def test_messages_read_like_numbers_and_lists():
    measurement = Measurement(sequence=7, velocity_m_s=(1.0, 2.0, 3.0))
    assert measurement.velocity_m_s == [1.0, 2.0, 3.0]
    assert f"{measurement.velocity_m_s}" == "[1.0, 2.0, 3.0]"
    assert "sequence=7" in repr(measurement) and "velocity_m_s=[1.0, 2.0, 3.0]" in repr(measurement)
    assert measurement.as_dict()["velocity_m_s"] == [1.0, 2.0, 3.0]
    assert measurement == Measurement(sequence=7, velocity_m_s=(1.0, 2.0, 3.0)) != Measurement()
    assert Estimate().as_dict()["translation"]["error_bound"] == 0.0


def test_status_rejections_and_replies_in_words():
    estimate = Estimate(status=status_bits.TRACKING | status_bits.FROZEN)
    assert estimate.words() == ["tracking", "frozen"]
    assert len(Estimate(status=2**64 - 1).words()) == 23
    status = Status()
    status.counters.samples_rejected[4] = 2
    assert status.rejected() == {"too late": 2}
    reply = Reply(message_bytes=5)
    reply.message[:6] = b"savedX"
    assert reply.text() == "saved"
    reply.message_bytes = 2**32 - 1
    assert reply.text().startswith("savedX")
    reply.message[0] = 0xFF
    assert reply.text() == ""


def test_a_deviation_may_be_infinite_but_not_nan():
    estimate = Estimate(velocity_std_m_s=(float("inf"),) * 3)
    assert estimate.is_finite()
    estimate.attitude_std_rad[1] = float("nan")
    assert not estimate.is_finite()
    assert not Estimate(velocity_m_s=(float("inf"),) * 3).is_finite()


@pytest.mark.parametrize("name", ["velocity", "velocity_ms"])
def test_a_misspelt_field_is_refused(name):
    with pytest.raises(AttributeError):
        getattr(Measurement(), name)
