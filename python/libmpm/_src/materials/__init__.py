"""Material laws, their parameters, and the stress that a body starts with."""
