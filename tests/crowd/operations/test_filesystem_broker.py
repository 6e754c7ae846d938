"""The embedded broker's files, as other processes find them and as killed ones leave them."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from kombu import Connection, Exchange, Queue
from kombu.transport.virtual import Channel

from crowd import celery
from crowd.operations.filesystem_broker import Transport

EXCHANGE = Exchange("work", type="direct")
QUEUE = Queue("work", EXCHANGE, routing_key="work")


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Connection]:
    Transport.global_state.clear()  # what this process believes to be bound, in whatever folder
    options = {name: str(tmp_path) for name in ("data_folder_in", "data_folder_out", "control_folder")}
    with Connection("filesystem://localhost", transport_options=options) as connection:
        yield connection


@pytest.fixture
def channel(broker: Connection) -> Channel:
    return broker.channel()


def send(broker: Connection, body: str) -> None:
    with broker.Producer() as producer:
        producer.publish(body, exchange=EXCHANGE, routing_key="work", declare=[QUEUE], retry=False)


def received(broker: Connection) -> list[str]:
    queue, found = QUEUE(broker.channel()), []
    queue.declare()
    while (message := queue.get(no_ack=True)) is not None:
        found.append(message.payload)
    return found


def test_the_project_uses_its_own_transport(broker: Connection) -> None:
    assert celery.app.connection("filesystem://localhost").transport_cls == "filesystem"
    assert type(broker.transport).__module__ == "crowd.operations.filesystem_broker"


def test_messages_come_in_the_order_in_which_they_were_sent(broker: Connection, tmp_path: Path) -> None:
    for body in ("one", "two", "three"):
        send(broker, body)

    assert received(broker) == ["one", "two", "three"]
    assert [path.name for path in tmp_path.glob("*.msg")] == []


@pytest.mark.parametrize(
    "left",
    ["", '{"body": "b25l', "\0\0\0\0", "{}", "[]", '{"body": "b25l", "properties": {"delivery_info": {}}}'],
)
def test_what_is_no_message_is_put_aside(broker: Connection, tmp_path: Path, left: str) -> None:
    (tmp_path / "0_first.work.msg").write_text(left)
    send(broker, "whole")

    assert received(broker) == ["whole"]
    assert not list(tmp_path.glob("*.msg"))
    assert [path.read_text() for path in (tmp_path / "dead-letters").iterdir()] == [left]


def test_what_is_being_written_is_no_message_yet(
    broker: Connection, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    send(broker, "first")
    received(broker)

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("crowd.operations.filesystem_broker.os.replace", killed)
    with pytest.raises(KeyboardInterrupt):
        send(broker, "half")
    monkeypatch.undo()

    assert received(broker) == []
    send(broker, "next")
    assert received(broker) == ["next"]


@pytest.mark.parametrize("left", ["", '[["work", ""'])
def test_a_table_of_bindings_that_cannot_be_read_is_made_again(
    broker: Connection, tmp_path: Path, left: str
) -> None:
    (tmp_path / "work.exchange").write_text(left)

    send(broker, "one")

    assert received(broker) == ["one"]


def test_bindings_of_several_queues_are_all_kept(broker: Connection, channel: Channel) -> None:
    for name in ("a", "b", "a"):
        Queue(name, EXCHANGE, routing_key=name)(channel).declare()

    assert sorted(row.queue for row in channel.get_table("work")) == ["a", "b"]
