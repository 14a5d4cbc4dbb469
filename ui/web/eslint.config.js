// Rules of the pages that the type checker does not know; numbers as `pyproject.toml` has them.
const ONE_STATE = "What a page remembers is one object: `const state = { ... }`.";

export default [{
  files: ["**/*.js", "**/*.mjs"],
  linterOptions: { reportUnusedDisableDirectives: "error" },
  rules: {
    "eqeqeq": "error",
    "max-len": ["error", { code: 100 }],
    "max-lines": ["error", 500],
    "max-lines-per-function": ["error", 60],
    "max-params": ["error", 5],
    "no-else-return": "error",
    "no-eval": "error",
    "no-implied-eval": "error",
    "no-restricted-properties": ["error", {
      property: "innerHTML", message: "Text is only ever written as text.",
    }],
    "no-restricted-syntax": ["error",
      {
        selector: ":matches(Program, ExportNamedDeclaration) > VariableDeclaration[kind!='const']",
        message: ONE_STATE,
      },
      {
        selector: "Program > VariableDeclaration > VariableDeclarator[id.name!='state']"
          + " > NewExpression[callee.name=/^(Weak)?(Map|Set)$/][arguments.length=0]",
        message: ONE_STATE,
      },
    ],
    "no-shadow": "error",
    "no-useless-return": "error",
    "no-var": "error",
    "object-shorthand": "error",
    "prefer-const": "error",
    "prefer-template": "error",
  },
}];
