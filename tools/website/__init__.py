"""Builds the site of the documentation: `make docs`, or `python -m tools.website`.

    docs/  README.md ...  src/barewire          the repository
             |                |
          links            source, docstrings
             |                |
             '---- stage -----'                 build/docs: Markdown and reStructuredText
                      |
                   Sphinx                       docs/conf.py
                      |
                  build/site                    HTML that needs no other server, and no network

Files, in reading order:

    links        where a file of the repository is on the site
    source       the public names of src/barewire, read without importing it
    docstrings   a docstring as reStructuredText
    api          a page for each room
    messages     every message of Modbus and CANopen, with its drawing, its clause and a frame
    errors       every exception, and every reason of a DecodeError
    commands     the help of every command
    parameters   every parameter of the three devices
    classroom    the labs to project, to print, and their solutions
    stage        everything together, in build/docs
    explorer     the page that runs the package in the browser, from docs/explorer
    check        what a reader would miss in the HTML: links that lead nowhere, requests to other servers
    __main__     the command
    browser      Chromium, for the explorer's pictures and for tests
    screenshots  pictures of pages, for eyes
    explorer_shots   pictures of the views of the explorer
    panel_shots      pictures of the panel
"""
