"""Stage control: which reference points are seen in which photo."""
