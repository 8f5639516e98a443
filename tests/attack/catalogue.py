"""All attacks by name, in the order in which a table shows them."""

from __future__ import annotations

from attack.base import Attack
from attack.folders import Folders
from attack.forged import Forged
from attack.inputs import Inputs
from attack.kills import Kills
from attack.messages import Messages
from attack.studies import Studies
from attack.values import Values

__all__ = ["ATTACKS"]

_KINDS = (Kills, Studies, Inputs, Values, Forged, Messages, Folders)
ATTACKS: dict[str, type[Attack]] = {kind.name: kind for kind in _KINDS}
