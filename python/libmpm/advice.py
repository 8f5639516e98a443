"""Which settings to take: what `Scene.advise` returns; `tradeoff`, which measures on a scene."""

from libmpm._src.advice.result import Advice
from libmpm._src.advice.tradeoff.result import TradeOff
from libmpm._src.advice.tradeoff.run import tradeoff

__all__ = ["Advice", "TradeOff", "tradeoff"]
