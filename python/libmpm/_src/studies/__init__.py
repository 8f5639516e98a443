"""Many runs and what follows from them: studies, debris fields, statistics, demand, design."""
