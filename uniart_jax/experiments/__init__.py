"""The paper's experiments: arms that are trained alike but for one thing, judged on the same
held-out objects, as one table."""
