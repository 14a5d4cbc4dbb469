"""One judgement of a block: rules, verdict, accuracy."""
