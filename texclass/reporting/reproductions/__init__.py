"""The tables and figures of the papers, published beside ours: one module per paper."""
