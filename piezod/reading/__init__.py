"""Records of others: tables of numbers in the files that laboratories have.

`read_record` in `record` is the one door: any command that takes a record reads it there.
"""
