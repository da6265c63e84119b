"""The paper this project began from, reproduced item by item and judged."""
