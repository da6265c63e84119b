"""The paper this project began from, reproduced item by item and judged.

"Experiment Design, Bayesian Estimation and Model Selection of an Autonomous Underwater Vehicle".
"""
