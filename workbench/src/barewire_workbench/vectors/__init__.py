"""The vectors: cases as JSON, the questions that they ask an implementation, and the judgement of its answers.

    case        a row of a file in vectors/: fields, and the result that an implementation must come to
    question    one operation of a case, as JSON: what is given, without what is expected
    answer      what an implementation gives back: fields, a refusal, or "not offered"
    verdict     passed, open (the standard leaves it open, and the answer differs from ours), failed, not offered

    files       the files, in a folder or in the installed package
    questions   case -> questions, by vectors/kinds.json
    judge       question and answer -> verdict
    tested_device  the same of device-conformance: what a device has, and what was received from it
    profiles    named choices of cases, and the badge of a run
    run         cases -> their verdicts, by any implementation that answers
    answers/    the answers of barewire itself, a function for each kind

An implementation in any language answers the same questions as lines of JSON: `barewire vectors check --adapter`.
"""
