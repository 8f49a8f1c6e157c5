"""What accuracy costs: time, features, seconds of touch, bits; the recogniser at a budget."""
