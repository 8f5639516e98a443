"""Speed for accuracy: what numerical choices cost and what they gain, on a scene of yours."""
