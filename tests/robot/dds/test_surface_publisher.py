import time

from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from texclass.recognition import Answer, Event, Evidence, WindowAnswer
from texclass.robot import SurfacePublisher
from texclass.robot.dds import dds_topic, message_class, participant, quality

P = {"cork": 0.02, "oak": 0.98}


def test_typed_messages_arrive_with_their_content():
    member, qos = participant(), quality("reliable", 10)
    kinds = {
        "/surface": "texclass_msgs/msg/SurfaceAnswer",
        "/surface/contact": "texclass_msgs/msg/ContactEvent",
        "/diag": "diagnostic_msgs/msg/DiagnosticArray",
    }
    readers = {
        name: DataReader(member, Topic(member, dds_topic(name), message_class(kind), qos=qos), qos=qos)
        for name, kind in kinds.items()
    }
    answer = Answer("window", "oak", 0.98, "cork", unknown=False, p_known=0.5, probabilities=P)
    verdict = Evidence(("cork", "oak")).add(answer, contact_s=1.0)
    updates = (
        Event("contact", sample=1000, n_received=1100, end=1000),
        WindowAnswer(1000, 2000, 2010, answer, verdict, onset=1000, compute_ms=1.0),
    )
    publisher = SurfacePublisher("/surface", "/diag", frame="tool")
    received, end = {}, time.monotonic() + 20
    while len(received) < len(kinds) and time.monotonic() < end:
        for update in updates:
            publisher.publish_update(update, time_of=lambda sample: 10**18 + sample * 10**6)
        time.sleep(0.05)
        for name, reader in readers.items():
            messages = [message for message in reader.take(10) if hasattr(message, "header")]
            received |= {name: messages[-1]} if messages else {}
    publisher.close()
    surface, event, diagnostics = (received[name] for name in kinds)
    assert (surface.surface, surface.probability, surface.sure) == ("oak", verdict.probability, verdict.sure)
    assert dict(zip(surface.surfaces, surface.probabilities, strict=True)) == verdict.probabilities
    assert (surface.header.stamp.sec, surface.header.frame_id) == (10**9 + 2, "tool")
    assert (event.kind, event.header.stamp.sec) == (1, 10**9 + 1)
    assert (diagnostics.status[0].level, diagnostics.status[0].message) == (0, "oak")
