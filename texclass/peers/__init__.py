"""Peers: what users would get from the tools they use now, on the same folds."""

from texclass.peers.comparison import PeerSettings, compare_with_peers, whole_materials
from texclass.peers.peer_worker.registry import PEERS, Peer
from texclass.peers.result import Contestant, Cost, PeerComparison

__all__ = [
    "PEERS",
    "Contestant",
    "Cost",
    "Peer",
    "PeerComparison",
    "PeerSettings",
    "compare_with_peers",
    "whole_materials",
]
