"""Fields of debris: what they are made of, how they are placed, measured and drawn."""
