"""Which throw next: proposals, and throws flown in simulation.

    proposal = throws.next_throw(campaign, throws.findings_of(result), launches=1)
    for sentence in throws.sentences(proposal):
        print(sentence)
    flight = throws.fly_throw(model, proposal.throws[0], proposal.place, rng)

Findings: what an analysis leaves open; findings_of and load_findings make it of a
result and of a report's folder. next_throw: a Proposal. sentences, draw_proposal,
write_proposal: the proposal in words, as a picture, as files that a flight computer can
play. ThrowLimits, load_limits: what throws keep to. fly_throw: one, simulated and
logged as a Flight. rehearse: which effects the flights of a campaign would show.
"""

from glider.campaign.logs import Flight
from glider.experiments.explanations import Findings, findings_of, load_findings
from glider.experiments.proposal import Proposal, next_throw
from glider.experiments.rehearsal import rehearse
from glider.experiments.throw_limits import ThrowLimits, load_limits
from glider.experiments.throws import fly_throw
from glider.report.next_throw import draw_proposal, sentences, write_proposal
