"""Screens of the terminal, with Textual: `sniff --live` and `panel --terminal`, for those without a browser.

heard      what `sniff --live` hears: rows, findings, rates, a filter; one thread puts, the screen takes
screen     what both screens have: a list that scrolls, questions, signals
sniffing   the screen of `sniff --live`
machine    the screen of `panel --terminal`
scope      values over time, drawn with bars, on that screen
"""
