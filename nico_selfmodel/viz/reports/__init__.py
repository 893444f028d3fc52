"""The report: one page, made of sections that each kind of evidence offers."""
