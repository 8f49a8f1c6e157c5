"""Anisotropic textures of Abdulali and Jeon: input-space segments, AR -> LSF, RBF network; `abdulali2016`."""

from texclass.textures.abdulali2016.baked import BakedTexture, bake
from texclass.textures.abdulali2016.cross_validation import CrossValidation, cross_validate
from texclass.textures.abdulali2016.delaunay import DelaunayTexture
from texclass.textures.abdulali2016.fitting import ModelledScan, fit_as_published, fit_texture, model_scan
from texclass.textures.abdulali2016.frame import Frame
from texclass.textures.abdulali2016.network import RadialNetwork, fit_exact, fit_sparse
from texclass.textures.abdulali2016.preprocessing import condition, downsample, scan_from_sensors
from texclass.textures.abdulali2016.segmentation import InputSegments, segment_input
from texclass.textures.abdulali2016.simulated import SURFACES, Surface, simulate_scan, surface
from texclass.textures.abdulali2016.texture import NetworkTexture

__all__ = [
    "SURFACES",
    "BakedTexture",
    "CrossValidation",
    "DelaunayTexture",
    "Frame",
    "InputSegments",
    "ModelledScan",
    "NetworkTexture",
    "RadialNetwork",
    "Surface",
    "bake",
    "condition",
    "cross_validate",
    "downsample",
    "fit_as_published",
    "fit_exact",
    "fit_sparse",
    "fit_texture",
    "model_scan",
    "scan_from_sensors",
    "segment_input",
    "simulate_scan",
    "surface",
]
