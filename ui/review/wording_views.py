"""Words of the views laid over the desk (fiducials, film, placement) and of the placing page."""

VIEWS: dict[str, str] = {
    # fiducial board
    "board": "Fiducials",
    "board.tip": "Every photo by every mark, most doubtful first: look, correct, leave out",
    "board.board": "Board",
    "board.film": "Film",
    "board.count": "{photos} photos \u00b7 {doubtful} doubtful marks",
    "board.none": "No camera of this block has fiducials: give fiducials_mm in block.toml, or let "
    "the marks be found by a new run.",
    "board.hidden": "left out",
    "board.missing": "not found",
    "board.scan-doubt": "Remarks: {count}",
    "board.state": "State",
    "board.state.used": "in use, as found",
    "board.state.placed": "in use, placed by hand",
    "board.state.hidden": "left out by hand",
    "board.state.unused": "left out: it does not fit the others",
    "board.state.missing": "not found",
    "board.residual": "Residual x, y",
    "board.residual.tip": "On the film: where it is measured minus where the certificate puts it; "
    "of marks that are not used what it would be",
    "board.score": "Score",
    "board.score.tip": "Likeness to the drawn mark, 0 to 1",
    "board.apart": "Two ways differ by",
    "board.apart.tip": "Every mark is centred in two independent ways",
    "board.sigma": "Sigma",
    "board.place": "Measured at",
    "board.rms": "Scan RMS",
    "board.model.similarity": "similarity",
    "board.model.affine": "affine",
    "board.model.projective": "projective",
    "board.model.bilinear": "bilinear",
    "board.model.nominal": "no orientation",
    "board.keep": "Keep",
    "board.keep.tip": "The mark is right as it is; go to the next doubtful one",
    "board.hide": "Not visible",
    "board.hide.tip": "The mark cannot be seen or is wrong: the scan is oriented without it",
    "board.snap": "Snap",
    "board.snap.tip": "Move it onto the mark beside it, by the same mark in another scan or by "
    "its symmetry",
    "board.undo": "Undo",
    "board.undo.tip": "Take back your last decision",
    "board.next": "Next doubtful mark (J)",
    "board.previous": "The one before (K)",
    "board.said": "Decided by {who}, {when} UTC",
    "board.hint": "Click places the mark, arrows nudge it by 0.1 px (Shift: 1 px), drag moves, "
    "wheel zooms. Dashed: where the other marks put it.",
    "board.run": "The block is adjusted with it at once. The next gruber run orients the scan "
    "with it and makes anew all that follows.",
    "notice.snapped": "{name} snapped: moved by {distance} px, likeness {alike}.",
    "notice.not-snapped": "Not snapped: {why}.",
    "notice.undo.PlaceFiducial": "Taken back: fiducial {what} placed by hand",
    "notice.redo.PlaceFiducial": "Again: fiducial {what} placed by hand",
    "did.PlaceFiducial": "fiducial placed",
}
"""English."""
