from .forward_selection import ForwardSelector as ForwardSelector
from .kernel_discriminant import KernelDiscriminant as KernelDiscriminant
from .segment_voting import SegmentVoting as SegmentVoting
