"""WHICH JOINTS CAN I TRUST? Signs of errors in captured poses, and one ranking of them."""
