from .comparison import PeerComparison as PeerComparison
from .comparison import PeerSettings as PeerSettings
from .comparison import compare_with_peers as compare_with_peers
from .comparison import whole_materials as whole_materials
from .peer_worker.peers import PEERS as PEERS
from .peer_worker.peers import Peer as Peer
