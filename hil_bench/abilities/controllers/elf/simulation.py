"""The loop of the process that simulates a chip: requests of the bench, one after the other."""

import gc
import os
import socket

from hil_bench.abilities.controllers.busy_wait import BusyWait
from hil_bench.abilities.controllers.elf.exchange import (
    AWAKE,
    Answer,
    Order,
    State,
    pack_answer,
    receive_message,
    send_message,
    unpack_request,
)
from hil_bench.abilities.controllers.elf.job import read_job
from hil_bench.abilities.controllers.elf.machine import Machine
from hil_bench.errors import ConfigError, ControllerError


def simulate(link: socket.socket) -> None:
    """Simulate the chip that the first message names until the bench lets go of the link."""
    try:
        machine = Machine(read_job(receive_message(link).decode()))
    except ConfigError as error:
        send_message(link, pack_answer(Answer(State.FAILED, AWAKE, [], str(error))))
        return
    send_message(link, pack_answer(Answer(State.RUNNING, AWAKE, [], "")))
    gc.freeze()  # it stays for good: no collection has to look at it
    busy = BusyWait(link.fileno())
    while True:
        busy.wait()
        message = receive_message(link)
        if not message:
            return
        if message[0] == Order.BRANCH:
            link = _branch(link)
            busy = BusyWait(link.fileno())
        else:
            send_message(link, pack_answer(_obey(machine, message)))


def _branch(link: socket.socket) -> socket.socket:
    """Copy this process; return the link of the one that goes on here."""
    send_message(link, pack_answer(Answer(State.RUNNING, AWAKE, [], "")))
    _, descriptors, _, _ = socket.recv_fds(link, 1, 1)
    other = socket.socket(fileno=descriptors[0])
    if os.fork():
        other.close()
        return link
    link.close()
    return other


def _obey(machine: Machine, message: bytes) -> Answer:
    order, time, received = unpack_request(message)
    if order is Order.POWER_CYCLE:
        machine.switch_on(time)
        return Answer(State.RUNNING, AWAKE, [], "")
    state, why, sent = State.RUNNING, "", []
    try:
        sent = machine.advance(time, received)
    except ControllerError as error:
        state, why = State.FAILED, str(error)
    wake = machine.wake
    text = "\n".join(part for part in (machine.take_text(), why) if part)
    return Answer(state, AWAKE if wake is None else wake, sent, text)
