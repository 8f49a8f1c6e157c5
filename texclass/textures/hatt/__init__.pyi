from .arma_texture import HattTexture as HattTexture
from .speed_force_mesh import Mesh as Mesh
from .speed_force_mesh import triangulate as triangulate
