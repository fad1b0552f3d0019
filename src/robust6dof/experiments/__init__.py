"""The paper's experiments: each makes its table and its figure from predict and evaluate."""
