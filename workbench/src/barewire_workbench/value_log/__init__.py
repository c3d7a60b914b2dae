"""Logs of values that are read periodically: which rows are written, and files that a power cut leaves whole.

sample          what was read at one time, and its row; the columns of a log
condition       "STATUS WORD.3 == 1": when a row is written
selection       which samples become rows: conditions, changes, one in so many
csv_file        a CSV file to which rows are added; half a line at its end is cut off
sqlite_file     the same as a table in an SQLite database
rotating_log    one of them: when it is synced, renamed and begun anew; rows that wait for space on the disk
reader          the values of such files, to draw them
"""
