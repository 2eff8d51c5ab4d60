"""The requests by which people begin and end a recording of a bench that runs."""

from hil_bench.abilities.live.messages import TEXT, AddedAction

_PART = "hil_bench.abilities.recording.sessions:LiveRecording"
_PATIENCE = 60.0  # with a disk [s]

ACTIONS = {
    "start_recording": AddedAction({"path": TEXT}, part=_PART, patience=_PATIENCE),
    "stop_recording": AddedAction({}, part=_PART, patience=_PATIENCE),
}
