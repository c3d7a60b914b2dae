"""A client or server of the stack as one file, to paste into another project. Files in reading order:

    sources       the modules as text: what each statement defines and uses
    one_file      the statements that some names need, and their text
    recipes       what each file is made of
    patches       branches that a small file never takes
    head          the head of a file: the command that made it, and a digest
    make          a file by its recipe
    changes       what changed between two versions of a file

What a small file has in place of a part of the stack is in `live/one_file`.
"""
