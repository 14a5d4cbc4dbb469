"""What each verb does, from its parsed arguments to the sentences for the operator."""
